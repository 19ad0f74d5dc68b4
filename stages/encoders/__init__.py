"""Frozen 2D encoders behind one interface, one file a family. `names` and `weights` are light (planning); the rest
imports torch."""
