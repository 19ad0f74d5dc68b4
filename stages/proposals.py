"""What these stages propose to the engine, which names none of them itself."""

from __future__ import annotations

OUTPUTS = ["reweight", "optimize", "score"]
"""What a run wants that does not say."""
PACKAGES = ["scipy", "torch", "transformers", "trimesh", "embreex", "pyrender", "potpourri3d", "manifold3d"]
"""Packages whose versions are recorded beside every artifact, for they may change a result."""
