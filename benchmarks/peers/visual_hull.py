"""Space carving: the voxels that most masks contain, and the lowest of them."""

import numpy as np
from scipy import ndimage

from benchmarks.peers.blobs import Blobs, SourceEstimate
from geometry.arrays import FloatArray
from geometry.grid import VoxelBox

SHARE = 0.8
"""Of the masks that could contain a voxel; all of them would be the classical hull."""
FEWEST_VIEWS = 3


def carve(blobs: Blobs, box: VoxelBox) -> SourceEstimate | None:
    """The middle of the lowest layer of the largest body; None where nothing is left.

    The covariance is the scatter of that layer's voxels.
    """
    masks = [i for i, mask in enumerate(blobs.masks) if mask.any()]
    centers = box.centers_in_world(np.argwhere(np.ones(box.shape)).astype(float))
    inside, seen = np.zeros((2, len(centers)))
    height, width = blobs.masks.shape[1:]
    for i in masks:
        pixels, depth = _project(blobs, i, centers)
        shown = (depth > 0) & ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
        columns, rows = pixels[shown].T
        seen += shown
        inside[shown] += blobs.masks[i][rows, columns]
    full = (inside >= SHARE * seen) & (seen >= max(FEWEST_VIEWS, len(masks) / 2))
    labels, count = ndimage.label(full.reshape(box.shape))
    if not count:
        return None
    largest = 1 + np.bincount(labels.ravel())[1:].argmax()
    body = np.argwhere(labels == largest)
    lowest = box.centers_in_world(body[body[:, 0] == body[:, 0].min()].astype(float))
    scatter = np.cov(lowest.T, bias=True) + box.voxel**2 / 12 * np.eye(3)
    return SourceEstimate(source=lowest.mean(axis=0), covariance=scatter)


def _project(blobs: Blobs, i: int, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2) nearest pixels and (N,) depths."""
    in_cam = blobs.trajectory.world_to_cam(i, points)
    depth = in_cam[:, 2]
    flat = in_cam / np.where(depth > 0, depth, 1)[:, None]
    pixels = flat @ blobs.trajectory.camera.matrix[:2].T
    return np.rint(pixels).astype(np.int64), depth
