"""Refraction in a single frame: a network, and the phase of lattices."""

from detect.dybs.detector import DybsDetector

__all__ = ["DybsDetector"]
