"""Training of the networks, and their calibration: the only place that knows torch."""
