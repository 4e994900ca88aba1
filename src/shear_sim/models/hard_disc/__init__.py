"""Hard disc."""
