"""Many materials → one texture with coordinates within [0, 1], so that a renderer needs neither materials nor
wrapping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from b23d.stages.geometry.surface import GREY, Material, unique_colors

SIDE = 2048
"""The atlas's longest side, pixels, about."""
TILE = 1024
"""Longest side of one image in it, repeats included, pixels."""
REPEATS = 16
"""A face that repeats its image more often than this along an axis shows its mean colour instead."""
MARGIN = 2
"""Pixels repeated around each image, so that interpolation never mixes neighbours."""
SLACK = 1e-3
"""How far beyond a whole number of repeats a coordinate may lie without asking for one more."""


def bake(
    materials: list[Material], face_materials: np.ndarray, face_uvs: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """One texture for all faces.

    `face_materials` (f,) index into materials, -1 for none; `face_uvs` (f, 3, 2) in repeats, NaN where a face has none.
    Returns face_uvs (f, 3, 2) float32 within [0, 1], origin at the lower left, and the texture (h, w, 3) uint8, first
    row on top; None where no face has a colour. Faces of a material with an image but without coordinates show its
    colour.
    """
    used = np.unique(face_materials[face_materials >= 0])
    if not any(materials[m].image is not None or materials[m].color is not None for m in used):
        return None
    uvs, spans = _unrolled(face_uvs, len(face_materials))
    look = _looks(materials, used, face_materials, uvs, spans)
    if len(look.tiles) == 1 and (look.tile_of == 0).all():
        return np.clip(uvs / look.repeats[:, None], 0, 1).astype(np.float32), look.tiles[0]
    return _laid_out(look, uvs)


@dataclass
class _Looks:
    """What each face shows: a place in a tile, or a plain colour."""

    tiles: list[np.ndarray]
    """(h, w, 3) uint8 each."""
    tile_of: np.ndarray
    """(f,) int64, -1 for a plain colour."""
    repeats: np.ndarray
    """(f, 2), of its image in its tile, across and up."""
    colors: np.ndarray
    """(f, 3) uint8, what it shows without a tile."""


def _unrolled(face_uvs: np.ndarray | None, faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (f, 3, 2) less the whole repeats, which change nothing, and how many repeats each face needs (f, 2);
    NaN where a face has none."""
    uvs = np.full((faces, 3, 2), np.nan) if face_uvs is None else face_uvs.copy()
    with np.errstate(invalid="ignore"):
        lowest = np.minimum(np.minimum(uvs[:, 0], uvs[:, 1]), uvs[:, 2])
        uvs -= np.floor(lowest + SLACK)[:, None]
        highest = np.maximum(np.maximum(uvs[:, 0], uvs[:, 1]), uvs[:, 2])
        return uvs, np.maximum(np.ceil(highest - SLACK), 1)


def _looks(
    materials: list[Material], used: np.ndarray, face_materials: np.ndarray, uvs: np.ndarray, spans: np.ndarray
) -> _Looks:
    """A tile for each material with an image, as often repeated as its faces need; the rest in plain colours."""
    count = len(face_materials)
    look = _Looks([], np.full(count, -1), np.ones((count, 2)), np.tile(np.array(GREY, np.uint8), (count, 1)))
    pictured = sum(materials[m].image is not None for m in used)
    side = min(TILE, int(SIDE / math.sqrt(max(pictured, 1))))
    for m in used:
        image = materials[m].image
        faces = np.flatnonzero(face_materials == m)
        if image is None:
            look.colors[faces] = materials[m].color or GREY
            continue
        look.colors[faces] = materials[m].color or mean_color(image)
        has_uv = np.isfinite(uvs[faces]).all(axis=(1, 2))
        few = (np.nan_to_num(spans[faces], nan=np.inf) <= REPEATS).all(axis=1)
        look.colors[faces[has_uv & ~few]] = mean_color(image)
        shown = faces[has_uv & few]
        if len(shown):
            across, up = spans[shown].max(axis=0).astype(int)
            look.tile_of[shown] = len(look.tiles)
            look.repeats[shown] = across, up
            look.tiles.append(_tile(image, across, up, side))
    return look


def _laid_out(look: _Looks, uvs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All tiles and plain colours in one texture, and each corner's place in it: (f, 3, 2) float32, (h, w, 3) uint8."""
    plain = np.flatnonzero(look.tile_of < 0)
    palette, color_of = unique_colors(look.colors[plain])
    texture, corners = _pack([_with_margin(tile) for tile in look.tiles], palette)
    placed = np.empty_like(uvs)  # pixels from the upper left
    for t, tile in enumerate(look.tiles):
        faces = np.flatnonzero(look.tile_of == t)
        within = np.clip(uvs[faces] / look.repeats[faces, None], 0, 1)
        column, row = corners[t]
        placed[faces, :, 0] = column + MARGIN + within[..., 0] * tile.shape[1]
        placed[faces, :, 1] = row + MARGIN + (1 - within[..., 1]) * tile.shape[0]
    if len(plain):
        swatches = _swatch(np.arange(len(palette)), len(palette)) + _swatch_size(len(palette)) / 2
        placed[plain] = (corners[-1] + swatches)[color_of, None]
    height, width = texture.shape[:2]
    across, up = placed[..., 0] / width, 1 - placed[..., 1] / height
    return np.stack([across, up], axis=2).astype(np.float32), texture


def mean_color(image: np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (round(float(c)) for c in image.reshape(-1, 3).mean(axis=0))
    return red, green, blue


def _tile(image: np.ndarray, across: int, up: int, side: int) -> np.ndarray:
    """The image repeated `across` × `up` times, at most about `side` pixels a side."""
    height, width = image.shape[:2]
    ratio = min(1.0, side / (width * across), side / (height * up))
    if ratio < 1:
        size = (max(1, round(width * ratio)), max(1, round(height * ratio)))
        image = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
    return np.tile(image, (up, across, 1))


def _with_margin(tile: np.ndarray) -> np.ndarray:
    return np.pad(tile, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode="edge")


def _swatch_size(count: int) -> int:
    """Pixels a side of one plain colour: a few, for renderers that blur; one where there are very many."""
    return 4 if count <= 1024 else 1


def _swatch(index: np.ndarray, count: int) -> np.ndarray:
    """Upper left corner (n, 2) of plain colours, in a square of them."""
    across = math.ceil(math.sqrt(count))
    return np.stack([index % across, index // across], axis=1) * _swatch_size(count)


def _pack(tiles: list[np.ndarray], palette: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """All tiles, and last the palette's square, in rows of falling height. Returns the texture and each one's (column,
    row)."""
    pieces = list(tiles)
    if len(palette):
        pieces.append(_palette_square(palette))
    limit = max(SIDE, max(piece.shape[1] for piece in pieces))
    tallest_first = sorted(range(len(pieces)), key=lambda i: -pieces[i].shape[0])
    corners = [(0, 0)] * len(pieces)
    column = row = tallest = width = 0
    for i in tallest_first:
        height, across = pieces[i].shape[:2]
        if column + across > limit:
            row += tallest
            column = tallest = 0
        corners[i] = (column, row)
        column += across
        tallest = max(tallest, height)
        width = max(width, column)
    texture = np.full((row + tallest, width, 3), 255, np.uint8)
    for (column, row), piece in zip(corners, pieces, strict=True):
        texture[row : row + piece.shape[0], column : column + piece.shape[1]] = piece
    return texture, corners


def _palette_square(palette: np.ndarray) -> np.ndarray:
    """The plain colours (n, 3) as swatches in a square image (h, h, 3)."""
    across = math.ceil(math.sqrt(len(palette)))
    size = _swatch_size(len(palette))
    square = np.zeros((across * across, 3), np.uint8)
    square[: len(palette)] = palette
    return np.kron(square.reshape(across, across, 3), np.ones((size, size, 1), np.uint8))
