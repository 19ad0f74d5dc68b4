"""The `posterior` method: keypoints by their expected hits under a small probabilistic model learned from the shots.

It goes past the paper in four ways: a linear discriminant says what a keypoint looks like against everything that is
none; a deformation prior, moved towards what the shots show, says how keypoints move together in a common frame; where
they are, and which there are, is expected from the shots most like the target; and each keypoint is put where the
posterior expects most hits, not at its mode.

On KeypointNet's bathtubs and beds (3 draws, saliency ViT-S/14), against one mean of all shots for all targets, AUC is
.58 from .53 with 10 shots, .63 from .56 with 25, .67 from .60 with 50, and the same with three or fewer; on the
procedural classes .70 from .66 with 3.
"""
