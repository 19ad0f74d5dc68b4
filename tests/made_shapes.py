"""Shapes made by hand, through the stage: OBJ meshes and XYZ clouds."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.normalize import NormalizeParams, normalize


def obj(vertices: Any, faces: Any) -> bytes:
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*v) for v in np.asarray(vertices, np.float64)]
    lines += ["f {} {} {}".format(*f) for f in np.asarray(faces).reshape(-1, 3) + 1]
    return "\n".join(lines).encode()


def xyz(points: Any) -> bytes:
    return "\n".join("{:.17g} {:.17g} {:.17g}".format(*p) for p in np.asarray(points, np.float64)).encode()


def of_mesh(vertices: Any, faces: Any, cloud: Any = None, **params: Any) -> NormalizedShape:
    files = {"mesh.obj": obj(vertices, faces)} | ({} if cloud is None else {"cloud.xyz": xyz(cloud)})
    source = Source(shape="chair/one", files=files, mesh="mesh.obj", cloud=None if cloud is None else "cloud.xyz")
    return normalize(source, NormalizeParams(**{"count": 128, **params}))


def of_cloud(points: Any, shape: str = "chair/one", **params: Any) -> NormalizedShape:
    return normalize(
        Source(shape=shape, files={"c.xyz": xyz(points)}, cloud="c.xyz"), NormalizeParams(**{"count": 128, **params})
    )


def on_surface(shape: NormalizedShape) -> np.ndarray:
    """Where the faces and barycentrics of the candidates say that they are."""
    return np.einsum(
        "nc,ncx->nx",
        shape.point_barycentrics.astype(float),
        shape.vertices[shape.faces[shape.point_faces]].astype(float),
    )


BOX = trimesh.creation.box((1, 2, 4))
ROUGH = trimesh.creation.icosphere(subdivisions=2)
ROUGH.vertices *= np.random.default_rng(0).uniform(0.7, 1.3, (len(ROUGH.vertices), 1))
