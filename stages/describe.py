"""describe: axiomatic descriptors of the candidates, in the place of back-projected features."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import PointFeatures
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape


class Spectral(Params):
    eigenpairs: int = Field(default=128, ge=2)
    """How much of the Laplacian's spectrum is used."""


class Heat(Spectral):
    times: int = Field(default=16, ge=1)
    """Channels; diffusion times, spaced evenly in their logarithm."""
    shortest: float = Field(default=0.006, gt=0)
    """First diffusion time for unit surface area. Near 4 ln 10 / (4 π eigenpairs), where what is cut off weighs
    1e-4."""
    longest: float = Field(default=0.4, gt=0)
    """Last diffusion time. 4 ln 10 / λ of the first non-constant function on a sphere."""


class Wave(Spectral):
    energies: int = Field(default=100, ge=2)
    """Channels; energy levels, spaced evenly in their logarithm over the shape's own spectrum."""
    width: float = Field(default=7.0, gt=0)
    """Standard deviation of an energy level, in steps between levels."""


class Support(Params):
    radius: float = Field(default=0.2, gt=0)
    """Of the ball that is described, unit frame."""


class DescribeParams(Params):
    """Which descriptor, and its constants."""

    descriptor: Literal["hks", "wks", "shot"] = "hks"
    """"hks": heat kernel signature (Sun et al. 2009). "wks": wave kernel signature (Aubry et al. 2011). "shot":
    signatures of histograms of orientations (Salti et al. 2014)."""
    surface: Literal["auto", "mesh", "cloud"] = "auto"
    """What carries it: the mesh, or the candidates alone. "auto": the mesh where there is one, and for "hks" and "wks"
    only where all candidates are on one connected part of it, since heat and waves do not cross from part to part."""
    hks: Annotated[Heat, When(descriptor="hks")] = Heat()
    wks: Annotated[Wave, When(descriptor="wks")] = Wave()
    shot: Annotated[Support, When(descriptor="shot")] = Support()


@stage(version=1, hints=Hints(memory_gb=1.0))
def describe(normalize: NormalizedShape, params: DescribeParams) -> PointFeatures:
    """Descriptors at the candidates: "hks" (n, times) and "wks" (n, energies) of mean 1 over the surface; "shot" (n,
    352) of length 1.

    All three are invariant to rigid motion; "hks" and "wks" also to scale and to bending. `observed` is false where
    "shot" finds fewer than 5 neighbours; `counts` is 1 where observed.

    Raises ValueError where the candidates are too few, or the spectrum is empty.
    """
    describes = _shot if params.descriptor == "shot" else _spectral
    features, observed = describes(normalize, params)
    return PointFeatures(
        features=np.clip(features, None, np.finfo(np.float16).max).astype(np.float16),
        counts=observed.astype(np.int32),
        observed=observed,
        descriptor=params.descriptor,
    )


def _spectral(shape: NormalizedShape, params: DescribeParams) -> tuple[np.ndarray, np.ndarray]:
    from b23d.stages.descriptors.spectral import (
        cloud_spectrum,
        heat_kernel_signature,
        mesh_spectrum,
        wave_kernel_signature,
    )
    from b23d.stages.geodesics.connectivity import face_components, weld

    heat, wave = params.hks, params.wks
    eigenpairs = (wave if params.descriptor == "wks" else heat).eigenpairs
    on_mesh = _on_mesh(shape, params)
    if on_mesh and params.surface == "auto":
        places, faces = weld(shape.vertices, shape.faces)
        on_mesh = len(np.unique(face_components(len(places), faces)[shape.point_faces])) == 1
    if on_mesh:
        spectrum = mesh_spectrum(shape.vertices, shape.faces, shape.point_faces, shape.point_barycentrics, eigenpairs)
    else:
        spectrum = cloud_spectrum(shape.points, eigenpairs)
    if params.descriptor == "wks":
        features = wave_kernel_signature(spectrum, wave.energies, wave.width)
    else:
        features = heat_kernel_signature(spectrum, np.geomspace(heat.shortest, heat.longest, heat.times))
    return features, np.ones(len(features), dtype=bool)


def _shot(shape: NormalizedShape, params: DescribeParams) -> tuple[np.ndarray, np.ndarray]:
    from b23d.stages.descriptors.shot import shot
    from b23d.stages.geodesics.shortcuts import consistently_wound, face_normals

    trusted = _on_mesh(shape, params) and consistently_wound(shape.vertices, shape.faces)
    normals = face_normals(shape.vertices, shape.faces)[shape.point_faces] if trusted else None
    return shot(shape.points, params.shot.radius, normals)


def _on_mesh(shape: NormalizedShape, params: DescribeParams) -> bool:
    return params.surface != "cloud" and len(shape.faces) > 0 and bool((shape.point_faces >= 0).all())
