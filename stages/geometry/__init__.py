"""Shapes as arrays: reading, cleaning, sampling, nearest faces, keypoints on candidates. No paths: bytes in, arrays
out."""
