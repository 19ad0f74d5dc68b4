"""Dense correspondence between two shapes: which point of one is which of the other."""
