"""Flow against registered neighbours: refraction and parallax separated by least squares."""

from detect.registered.detector import RegisteredDetector

__all__ = ["RegisteredDetector"]
