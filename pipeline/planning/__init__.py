"""Every artifact that a run wants, by address, and what state it is in."""
