"""Ready tasks to workers, and what comes back; the only room that imports dask."""
