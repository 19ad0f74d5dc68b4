"""What a store is made of, and what lies beside its artifacts."""
