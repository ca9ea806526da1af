"""The lines of sight along which a frame has evidence."""

from dataclasses import dataclass

import numpy as np

from detect.detection import Detection
from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory

CELLS_ACROSS = 40
"""Cells along the width of a frame, each with one ray at most."""
LEAST_NATS = 1.0
"""Evidence of a pixel that has a ray; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class EvidenceRays:
    """Lines of sight of one frame.

    Attributes:
        segments_in_world: (R, 2, 3) from the camera to the background; R may be 0.
        llr: (R,) evidence of their pixels, nats.
    """

    segments_in_world: FloatArray
    llr: FloatArray


def rays_of_evidence(
    trajectory: Trajectory, row: int, detection: Detection, *, longest: float
) -> EvidenceRays:
    """The line of sight of the pixel with the most evidence, in each cell of a frame.

    Args:
        trajectory: Poses, and the pinhole camera of the undistorted frames.
        row: Of the frame in it.
        detection: What was measured in the frame.
        longest: Where the background is farther, or its distance not known, world units.
    """
    v, u = _strongest_pixels(detection)
    in_cam = trajectory.camera.rays(np.column_stack([u, v]))
    length = np.full(len(u), longest)
    if detection.inverse_depth is not None:
        nearness = detection.inverse_depth[v, u].astype(float)  # along the optical axis
        known = nearness * longest > in_cam[:, 2]
        length[known] = in_cam[known, 2] / nearness[known]
    start = trajectory.centers_in_world[row]
    ends = start + length[:, None] * (in_cam @ trajectory.rotations[row])
    return EvidenceRays(
        segments_in_world=np.stack([np.broadcast_to(start, ends.shape), ends], axis=1),
        llr=detection.llr[v, u].astype(float),
    )


def _strongest_pixels(detection: Detection) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns, one pixel a cell."""
    edge = max(1, detection.llr.shape[1] // CELLS_ACROSS)
    v, u = np.nonzero(detection.llr >= LEAST_NATS)
    strongest_first = np.argsort(-detection.llr[v, u], kind="stable")
    v, u = v[strongest_first], u[strongest_first]
    _, first = np.unique(np.column_stack([v, u]) // edge, axis=0, return_index=True)
    return v[first], u[first]
