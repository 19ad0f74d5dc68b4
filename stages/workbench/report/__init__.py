"""The report of a run: one HTML page, with 3D views that are loaded when opened. `b23d report`, and figures for
notebooks."""
