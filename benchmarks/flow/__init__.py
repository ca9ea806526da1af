"""Flow methods between a reference and a frame: simulated pairs, and real ones."""
