"""The science: one file a stage. Importing this package declares every stage and data set."""
