"""A camera that stood still: directions to plumes, no positions."""
