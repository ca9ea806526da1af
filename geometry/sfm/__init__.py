"""Structure from motion that explains itself: frames to camera poses, or a named failure."""

from geometry.sfm.reconstruct import reconstruct
from geometry.sfm.result import Reconstruction

__all__ = ["Reconstruction", "reconstruct"]
