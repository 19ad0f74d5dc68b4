"""What scans suffer from, each a function of a clean shape, an amount and a random generator."""
