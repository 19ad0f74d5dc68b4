"""Parts as a Wavefront OBJ: an object and a material each, colours at the vertices, textures in PNGs beside."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from b23d.pipeline.inspection.artifact import MARK
from b23d.stages.workbench.pictures.solids import SceneObject


def write_obj(parts: list[SceneObject], path: Path, comment: str) -> None:
    """Written here, not by trimesh: it gives eight decimals to coordinates of any size, and names no object.

    Points without faces become `p` elements.
    """
    lines = [f"# {MARK}", f"# {comment}", f"mtllib {path.with_suffix('.mtl').name}"]
    materials: list[str] = []
    before, uvs_before = 0, 0
    for number, part in enumerate(parts):
        lines.append(f"o {part.name.replace(' ', '_')}")
        textured = part.uvs is not None and part.texture is not None
        colors = part.colors / 255
        for at, color in zip(part.vertices.tolist(), colors.tolist(), strict=True):
            lines.append("v {:.9g} {:.9g} {:.9g} {:.4f} {:.4f} {:.4f}".format(*at, *color))
        if part.uvs is not None and textured:
            lines += ["vt {:.6f} {:.6f}".format(*uv) for uv in part.uvs.tolist()]
        materials += [f"newmtl material{number}", *_material(part, path, number)]
        lines.append(f"usemtl material{number}")
        corners = part.faces.astype(np.int64) + before + 1
        if textured:
            coordinates = part.faces.astype(np.int64) + uvs_before + 1
            pairs = np.stack([corners, coordinates], axis=2).reshape(-1, 6).tolist()
            lines += ["f {}/{} {}/{} {}/{}".format(*pair) for pair in pairs]
            uvs_before += len(part.vertices)
        elif len(corners):
            lines += ["f {} {} {}".format(*corner) for corner in corners.tolist()]
        else:
            lines += [f"p {before + i + 1}" for i in range(len(part.vertices))]
        before += len(part.vertices)
    path.with_suffix(".mtl").write_text("\n".join(materials) + "\n", encoding="utf-8")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _material(part: SceneObject, path: Path, number: int) -> list[str]:
    """The MTL's lines: the texture, its image written beside the OBJ; the colour where there is one; white, which lets
    the vertices' colours through."""
    if part.texture is None:
        red, green, blue = part.colors[0] / 255 if len(np.unique(part.colors, axis=0)) == 1 else (1, 1, 1)
        return [f"Kd {red:.4f} {green:.4f} {blue:.4f}"]
    from PIL import Image

    image = path.with_name(f"{path.stem}-{number}.png")
    Image.fromarray(part.texture).save(image)
    return ["Kd 1 1 1", f"map_Kd {image.name}"]
