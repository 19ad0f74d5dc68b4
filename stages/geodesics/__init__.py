"""Geodesic distances between the candidates of a shape, and what makes them robust on real meshes and clouds."""
