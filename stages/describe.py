"""describe: axiomatic descriptors of the candidates, in the place of back-projected features."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import PointFeatures
from b23d.schemas.params import Params
from b23d.schemas.shape import NormalizedShape


class DescribeParams(Params):
    descriptor: Literal["hks", "wks", "shot"] = "hks"
    """"hks": heat kernel signature (Sun et al. 2009). "wks": wave kernel signature (Aubry et al. 2011). "shot":
    signatures of histograms of orientations (Salti et al. 2014)."""
    surface: Literal["auto", "mesh", "cloud"] = "auto"
    """What carries it: the mesh, or the candidates alone. "auto": the mesh where there is one, and for "hks" and "wks"
    only where all candidates are on one connected part of it, since heat and waves do not cross from part to part."""
    eigenpairs: int = Field(default=128, ge=2)
    """"hks", "wks": how much of the Laplacian's spectrum is used."""
    times: int = Field(default=16, ge=1)
    """"hks": channels; diffusion times, spaced evenly in their logarithm."""
    shortest: float = Field(default=0.006, gt=0)
    """"hks": first diffusion time for unit surface area. Near 4 ln 10 / (4 π eigenpairs), where what is cut off weighs
    1e-4."""
    longest: float = Field(default=0.4, gt=0)
    """"hks": last diffusion time. 4 ln 10 / λ of the first non-constant function on a sphere."""
    energies: int = Field(default=100, ge=2)
    """"wks": channels; energy levels, spaced evenly in their logarithm over the shape's own spectrum."""
    width: float = Field(default=7.0, gt=0)
    """"wks": standard deviation of an energy level, in steps between levels."""
    radius: float = Field(default=0.2, gt=0)
    """"shot": radius of the support, unit frame."""


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

    on_mesh = _on_mesh(shape, params)
    if on_mesh and params.surface == "auto":
        places, faces = weld(shape.vertices, shape.faces)
        on_mesh = len(np.unique(face_components(len(places), faces)[shape.point_faces])) == 1
    if on_mesh:
        spectrum = mesh_spectrum(
            shape.vertices, shape.faces, shape.point_faces, shape.point_barycentrics, params.eigenpairs
        )
    else:
        spectrum = cloud_spectrum(shape.points, params.eigenpairs)
    if params.descriptor == "wks":
        features = wave_kernel_signature(spectrum, params.energies, params.width)
    else:
        features = heat_kernel_signature(spectrum, np.geomspace(params.shortest, params.longest, params.times))
    return features, np.ones(len(features), dtype=bool)


def _shot(shape: NormalizedShape, params: DescribeParams) -> tuple[np.ndarray, np.ndarray]:
    from b23d.stages.descriptors.shot import shot
    from b23d.stages.geodesics.shortcuts import consistently_wound, face_normals

    trusted = _on_mesh(shape, params) and consistently_wound(shape.vertices, shape.faces)
    normals = face_normals(shape.vertices, shape.faces)[shape.point_faces] if trusted else None
    return shot(shape.points, params.radius, normals)


def _on_mesh(shape: NormalizedShape, params: DescribeParams) -> bool:
    return params.surface != "cloud" and len(shape.faces) > 0 and bool((shape.point_faces >= 0).all())
