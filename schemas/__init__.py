"""What a stage takes and gives: one pydantic model per artifact, which is also the on-disk format."""
