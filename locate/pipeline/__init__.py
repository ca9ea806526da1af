"""The run: from a recording to a map, by stages that are joined by files."""
