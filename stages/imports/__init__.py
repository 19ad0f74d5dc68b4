"""Files that other systems write, one reader a format."""
