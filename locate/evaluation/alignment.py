"""The map's world laid over the true one, by the cameras they share."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.errors import BadInputError
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class CameraAlignment:
    """How the cameras of a map lie over the true ones.

    Attributes:
        truth_from_map: The transform.
        frames: Number of frames both know.
        position_rmse: Of the camera centres after alignment, in the unit of the truth.
        rotation_median_deg: Median angle between the camera orientations after alignment.
    """

    truth_from_map: Similarity
    frames: int
    position_rmse: float
    rotation_median_deg: float


def align_trajectories(estimate: Trajectory, truth: Trajectory) -> CameraAlignment:
    """Aligns by whole poses; the scale is free only where the estimate's is.

    The rotation is the chordal mean of the relative orientations, because centres on an arc leave
    the roll about the path weak. Scale and translation follow from the centres (Umeyama, PAMI
    1991, with the rotation given).

    Raises:
        BadInputError: Too few frames in common, or the cameras of a scale-free map do not move.
    """
    _, rows, true_rows = np.intersect1d(estimate.indices, truth.indices, return_indices=True)
    if len(rows) < 2:
        raise BadInputError(
            f"the run and the truth share {len(rows)} frames, at least 2 are needed: "
            "is this the truth of that video?"
        )
    estimate, truth = estimate.take(rows), truth.take(true_rows)
    relative = Rotation.from_matrix(truth.rotations.transpose(0, 2, 1) @ estimate.rotations)
    mean = relative.mean()
    rotation = mean.as_matrix()
    centers, true_centers = estimate.centers_in_world, truth.centers_in_world
    turned = (centers - centers.mean(axis=0)) @ rotation.T
    scale = 1.0
    if not estimate.metric:
        spread = float((turned**2).sum())
        if spread == 0:
            raise BadInputError("the cameras of the map stand in one point: its scale is unknown")
        scale = float((turned * (true_centers - true_centers.mean(axis=0))).sum()) / spread
    transform = Similarity(
        scale=scale,
        rotation=rotation,
        translation=true_centers.mean(axis=0) - scale * rotation @ centers.mean(axis=0),
    )
    residual = transform(centers) - true_centers
    return CameraAlignment(
        truth_from_map=transform,
        frames=len(rows),
        position_rmse=float(np.sqrt((residual**2).sum(axis=1).mean())),
        rotation_median_deg=float(np.degrees(np.median((mean.inv() * relative).magnitude()))),
    )
