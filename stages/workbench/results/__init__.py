"""What a run made, as tables: gathering, rows, summaries, scores."""
