"""What a run made, as pictures: colours, painted shapes, figures, solids."""
