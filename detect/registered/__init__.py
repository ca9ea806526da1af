"""Flow against registered neighbours: refraction and parallax separated by least squares."""

from detect.registered.detector import RegisteredDetector
from detect.registered.displacement_only import DisplacementOnlyDetector

__all__ = ["DisplacementOnlyDetector", "RegisteredDetector"]
