"""Pages of a stated size."""
