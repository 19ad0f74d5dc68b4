"""What executions leave to be told later: of a store, of a run."""
