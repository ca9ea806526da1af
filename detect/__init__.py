"""Floor 2: what in an image is refraction: displacement, sigma, evidence."""

import geometry  # noqa: F401 - it limits OpenCV, which must come later
