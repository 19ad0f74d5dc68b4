"""A run file and its overrides, read and checked: what there is to set, and what a run is."""
