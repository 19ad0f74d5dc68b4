"""What a run has, looked at and kept well: listed, explained, tried again, verified, dropped."""
