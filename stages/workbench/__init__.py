"""What opens, compares and draws what a run made: results, pictures, pages, verbs, the Python API. Looks down on all
the rest."""
