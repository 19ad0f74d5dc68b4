"""The `posterior` method: keypoints by their expected hits under a small probabilistic model learned from the shots.

It goes past the paper in six ways: a linear discriminant says what a keypoint looks like against everything that is
none; a deformation prior, moved towards what the shots show, says how keypoints move together in a common frame; where
they are, and which there are, is expected from the shots most like the target; these shots are laid over it first, so
that its own surface carries their keypoints along; each keypoint is put where the posterior expects most hits, not at
its mode; and there the shots' own neighbourhoods of it say where within that.

On KeypointNet's bathtubs and beds (3 draws, block 9 of the saliency ViT-S/14) AUC is .43, .48, .58, .63 and .67 with
1, 3, 10, 25 and 50 shots; one mean of all shots for all targets gave .42, .47, .53, .56 and .60. By block 6 it is .44,
.49, .58 and .63 up to 25.
"""
