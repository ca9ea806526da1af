"""What the registered detector sees, and what its network adds to scores made by hand."""
