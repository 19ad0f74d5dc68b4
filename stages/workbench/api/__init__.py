"""The Python API: what `import b23d` offers. `load` a run file; or, without one, `features`, `keypoints`, `match`."""
