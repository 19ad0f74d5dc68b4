"""Several surfaces as one."""

from __future__ import annotations

import numpy as np

from b23d.stages.geometry.surface import GREY, Material, Surface, unique_colors


def merge(parts: list[Surface]) -> Surface:
    """One surface of several, one after another.

    Where some have images and others only vertex colours, the latter's faces take their corners' mean colour.
    """
    if any(material.image is not None for part in parts for material in part.materials):
        parts = [_painted(part) if part.vertex_colors is not None else part for part in parts]
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    whole = Surface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
    )
    whole.materials = [material for part in parts for material in part.materials]
    firsts = np.cumsum([0] + [len(part.materials) for part in parts])[:-1]
    if whole.materials:
        given = [np.full(len(part.faces), -1) if part.face_materials is None else part.face_materials for part in parts]
        shifted = [np.where(which < 0, -1, which + first) for which, first in zip(given, firsts, strict=True)]
        whole.face_materials = np.concatenate(shifted)
    if any(part.face_uvs is not None for part in parts):
        uvs = [np.full((len(part.faces), 3, 2), np.nan) if part.face_uvs is None else part.face_uvs for part in parts]
        whole.face_uvs = np.concatenate(uvs)
    if any(part.vertex_colors is not None for part in parts):
        whole.vertex_colors = np.concatenate([_vertex_colors(part) for part in parts])
    for part in parts:
        for what, times in part.problems.items():
            whole.count(what, times)
    return whole


def _painted(part: Surface) -> Surface:
    """The part with one plain material a face in place of its vertex colours."""
    assert part.vertex_colors is not None
    means = np.rint(part.vertex_colors[part.faces].astype(np.float64).mean(axis=1)).astype(np.uint8)
    palette, which = unique_colors(means)
    materials = [Material(color=(int(r), int(g), int(b))) for r, g, b in palette]
    return Surface(part.vertices, part.faces, None, materials, which, None, part.problems)


def _vertex_colors(part: Surface) -> np.ndarray:
    """A part's vertex colours; where it has none, those of its materials (its vertices are its own)."""
    if part.vertex_colors is not None:
        return part.vertex_colors
    colors = np.tile(np.array(GREY, np.uint8), (len(part.vertices), 1))
    if part.face_materials is not None:
        palette = np.array([material.color or GREY for material in part.materials] + [GREY], np.uint8)
        colors[part.faces] = palette[part.face_materials][:, None]
    return colors
