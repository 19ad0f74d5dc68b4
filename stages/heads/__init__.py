"""Small networks on per-point features: their inputs, training, calibration and use."""
