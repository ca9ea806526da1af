"""Floor 2: what in an image is refraction: displacement, sigma, evidence."""
