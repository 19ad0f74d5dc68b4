"""The `posterior` method: keypoints by their expected hits under a small probabilistic model learned from the shots.

It goes past the paper in three ways: a linear discriminant says what a keypoint looks like against everything that is
none; a deformation prior says how keypoints move together in a common frame, trusted as far as the shots agree on it;
and each keypoint is put where the posterior expects most hits, not at its mode.
"""
