"""Many materials → one texture with coordinates within [0, 1], so that a renderer needs neither materials nor
wrapping."""

from __future__ import annotations

import math

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
    uvs = np.full((len(face_materials), 3, 2), np.nan) if face_uvs is None else face_uvs.copy()
    with np.errstate(invalid="ignore"):
        uvs -= np.floor(np.minimum(np.minimum(uvs[:, 0], uvs[:, 1]), uvs[:, 2]) + SLACK)[
            :, None
        ]  # whole repeats change nothing
        highest = np.maximum(np.maximum(uvs[:, 0], uvs[:, 1]), uvs[:, 2])
        spans = np.maximum(np.ceil(highest - SLACK), 1)  # (f, 2) repeats that a face needs

    tiles: list[np.ndarray] = []
    tile_of = np.full(len(face_materials), -1)
    repeats = np.ones((len(face_materials), 2))
    pictured = [m for m in used if materials[m].image is not None]
    side = min(TILE, int(SIDE / math.sqrt(max(len(pictured), 1))))
    colors = np.tile(np.array(GREY, np.uint8), (len(face_materials), 1))
    for m in used:
        image, faces = materials[m].image, np.flatnonzero(face_materials == m)
        colors[faces] = materials[m].color or (GREY if image is None else mean_color(image))
        if image is None:
            continue
        has_uv = np.isfinite(uvs[faces]).all(axis=(1, 2))
        fits = has_uv & (np.nan_to_num(spans[faces], nan=np.inf) <= REPEATS).all(axis=1)
        colors[faces[has_uv & ~fits]] = mean_color(image)
        if fits.any():
            span = spans[faces[fits]].max(axis=0).astype(int)
            tile_of[faces[fits]], repeats[faces[fits]] = len(tiles), span
            tiles.append(_tile(image, span[0], span[1], side))

    if len(tiles) == 1 and (tile_of == 0).all():
        return np.clip(uvs / repeats[:, None], 0, 1).astype(np.float32), tiles[0]
    solid = np.flatnonzero(tile_of < 0)
    palette, which = unique_colors(colors[solid])
    texture, corners = _pack([_with_margin(tile) for tile in tiles], palette)
    height, width = texture.shape[:2]
    out = np.empty_like(uvs)
    for t, tile in enumerate(tiles):
        faces = np.flatnonzero(tile_of == t)
        within = np.clip(uvs[faces] / repeats[faces, None], 0, 1)
        column, row = corners[t][0] + MARGIN, corners[t][1] + MARGIN
        out[faces, :, 0] = (column + within[..., 0] * tile.shape[1]) / width
        out[faces, :, 1] = 1 - (row + (1 - within[..., 1]) * tile.shape[0]) / height
    if len(solid):
        column, row = corners[len(tiles)]
        place = _swatch(np.arange(len(palette)), len(palette)) + _swatch_size(len(palette)) / 2
        out[solid] = np.stack([(column + place[:, 0]) / width, 1 - (row + place[:, 1]) / height], axis=1)[which, None]
    return out.astype(np.float32), texture


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
        across, size = math.ceil(math.sqrt(len(palette))), _swatch_size(len(palette))
        square = np.zeros((across * across, 3), np.uint8)
        square[: len(palette)] = palette
        pieces.append(np.kron(square.reshape(across, across, 3), np.ones((size, size, 1), np.uint8)))
    limit = max(SIDE, max(piece.shape[1] for piece in pieces))
    corners = [(0, 0)] * len(pieces)
    column = row = tallest = width = 0
    for i in sorted(range(len(pieces)), key=lambda i: -pieces[i].shape[0]):
        height, across = pieces[i].shape[:2]
        if column + across > limit:
            column, row, tallest = 0, row + tallest, 0
        corners[i] = (column, row)
        column, tallest, width = column + across, max(tallest, height), max(width, column + across)
    texture = np.full((row + tallest, width, 3), 255, np.uint8)
    for (column, row), piece in zip(corners, pieces, strict=True):
        texture[row : row + piece.shape[0], column : column + piece.shape[1]] = piece
    return texture, corners
