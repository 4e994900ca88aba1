"""Parameter studies of sheared soft and granular matter in two dimensions."""
