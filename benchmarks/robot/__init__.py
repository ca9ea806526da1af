"""A robot's camera: cost and accuracy of a drive, live, played from a bag and repeated."""
