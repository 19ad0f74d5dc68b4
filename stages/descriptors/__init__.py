"""Axiomatic point descriptors: from the Laplace–Beltrami spectrum (HKS, WKS) and from local histograms (SHOT)."""
