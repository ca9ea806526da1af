"""The old place of `geometry.npz`."""

from geometry.npz import open_arrays, save_arrays

__all__ = ["open_arrays", "save_arrays"]
