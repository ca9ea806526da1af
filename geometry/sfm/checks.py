"""What a reconstruction must fulfil to be accepted, and the errors where it does not."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pycolmap
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray, IntArray
from geometry.camera import Camera
from geometry.errors import RegistrationError, RegistrationFailure
from geometry.sfm.features import MatchedPair

MIN_FRAMES = 3
"""Fewest frames of a reconstruction."""
MIN_FEATURES = 60
"""Least median number of features of an image; chosen."""
MIN_SHARE = 0.6
"""Least share of the frames that must be registered, or connected by matches."""
MIN_POINTS_PER_IMAGE = 30
"""Least median number of points of an image, and least number of matches that connect two."""
MIN_ANGLE_DEG = 1.0
"""Least median triangulation angle; below it depth is noise."""
MAX_FOCAL_DRIFT = 1.4
"""Largest factor between the estimated focal length and that of the metadata."""
FOCAL_RANGE = (0.35, 8.0)
"""Focal lengths of lenses in use, over the longest side of the image."""
STATIC_SHARE = 0.01
"""Image motion below which a camera counts as static, over the longest side."""
ROTATION_RESIDUAL_SHARE = 1.0 / 640
"""Misfit of a pure rotation below which it explains a pair, over the longest side."""
ROTATION_PAIR_SHARE = 0.9
"""Share of the pairs that a rotation must explain for the camera to have turned on the spot."""
MAX_DISAGREEMENT = 0.05
"""Largest distance between the paths of two methods, over their spread; chosen."""
MAX_ROTATION_DISAGREEMENT_DEG = 2.0
"""Largest median angle between the orientations of two methods; chosen."""
MAX_ROUGHNESS = 1.2
"""Largest roughness of a path: 1.7 for a random scatter, well below 1 for a carried camera."""
SUPPORT_PX = 3.0
"""Sampson error below which poses explain a match, px."""
MIN_SUPPORT = 0.6
"""Least share of matches that poses explain where a second method agrees."""
MIN_SUPPORT_ALONE = 0.85
"""The same where the second method does not agree."""
SECOND_METHOD_FRAMES = 12
"""About how many frames the second method uses."""

CURES = {
    RegistrationFailure.TOO_FEW_FRAMES: (
        "record at least a few seconds while moving, or give more photos"
    ),
    RegistrationFailure.STATIC_CAMERA: (
        "one viewpoint shows directions and not positions; move the camera sideways, "
        "or use the bos detector for bearings"
    ),
    RegistrationFailure.PURE_ROTATION: (
        "the camera turned on the spot; walk sideways or around the plume while filming"
    ),
    RegistrationFailure.LOW_TEXTURE: (
        "too few details to follow; film a textured background, closer, sharper or with more light"
    ),
    RegistrationFailure.SPLIT_MODELS: (
        "the frames do not all overlap; film without cuts and move more slowly, or give one part"
    ),
    RegistrationFailure.FOCAL_DIVERGED: (
        "give the focal length with --focal or a calibrated camera with --camera, "
        "or film from more directions"
    ),
    RegistrationFailure.SEVERAL_ZOOMS: (
        "a run has one camera; run the photos of each zoom from a folder of their own, or cut the "
        "video where the zoom changes"
    ),
    RegistrationFailure.IMPLAUSIBLE_POSES: (
        "two methods disagree about the path; film more slowly, with more overlap, "
        "or give poses with --poses"
    ),
}
"""What a person can do about each failure."""


def registration_error(failure: RegistrationFailure, what: str) -> RegistrationError:
    """The error that names a failure, its symptom and its cure."""
    return RegistrationError(failure, f"{what}; {CURES[failure]}")


def check_features(counts: Sequence[int]) -> None:
    """Raises where the typical image has too few features."""
    if np.median(counts) < MIN_FEATURES:
        raise registration_error(
            RegistrationFailure.LOW_TEXTURE,
            f"{np.median(counts):.0f} features in a typical image (needs {MIN_FEATURES})",
        )


def check_matches(pairs: Sequence[MatchedPair], camera: Camera, count: int) -> None:
    """Raises where no pair matches, nothing moves, or turning alone explains every pair.

    Args:
        pairs: Verified pairs.
        camera: The camera to start from.
        count: Number of images.
    """
    if len(pairs) < count - 1:
        raise registration_error(
            RegistrationFailure.LOW_TEXTURE
            if len(pairs) == 0
            else RegistrationFailure.SPLIT_MODELS,
            f"only {len(pairs)} pairs of {count} images match",
        )
    side = max(camera.width, camera.height)
    displacements = np.array([pair.displacement_px for pair in pairs])
    largest = float(np.quantile(displacements, 0.95))
    if largest < STATIC_SHARE * side:
        raise registration_error(
            RegistrationFailure.STATIC_CAMERA, f"the image moves by {largest:.1f} px in all"
        )
    far = [pair for pair in pairs if pair.displacement_px > max(0.5 * largest, STATIC_SHARE * side)]
    turned = np.array([rotation_residual_px(pair, camera) for pair in far])
    if np.mean(turned < ROTATION_RESIDUAL_SHARE * side) > ROTATION_PAIR_SHARE:
        raise registration_error(
            RegistrationFailure.PURE_ROTATION,
            f"turning alone explains the image motion to {np.median(turned):.2f} px",
        )


def rotation_residual_px(pair: MatchedPair, camera: Camera) -> float:
    """Median distance, px, left by the best rotation between two images; focal length free."""
    best = np.inf
    centre = np.array([camera.width, camera.height]) / 2
    for factor in np.geomspace(0.5, 2.0, 9):
        focal_px = camera.focal_px * factor
        rays = np.concatenate(
            [pair.pixels - centre, np.full((*pair.pixels.shape[:2], 1), focal_px)], axis=2
        )
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        rotation, _ = Rotation.align_vectors(rays[:, 1], rays[:, 0])
        moved = rotation.apply(rays[:, 0])
        pixels = focal_px * moved[:, :2] / np.maximum(moved[:, 2:], 1e-6) + centre
        error = np.linalg.norm(pixels - pair.pixels[:, 1], axis=1)
        best = min(best, float(np.median(error)))
    return best


def check_focal(focal_px: float, prior_px: float | None, side: int) -> None:
    """Raises where the estimated focal length left its prior, or any lens made."""
    low, high = FOCAL_RANGE
    if prior_px is not None and not 1 / MAX_FOCAL_DRIFT < focal_px / prior_px < MAX_FOCAL_DRIFT:
        raise registration_error(
            RegistrationFailure.FOCAL_DIVERGED,
            f"estimated at {focal_px:.0f} px where the metadata has {prior_px:.0f} px",
        )
    if not low < focal_px / side < high:
        raise registration_error(
            RegistrationFailure.FOCAL_DIVERGED,
            f"estimated at {focal_px:.0f} px for images of {side} px",
        )


@dataclass(frozen=True, kw_only=True)
class PathDisagreement:
    """How far two sets of poses of the same N cameras differ after the best similarity.

    Attributes:
        center_share: Median distance between centres over the rms spread of the centres.
        rotation_deg: Median angle between orientations.
        count: N.
    """

    center_share: float
    rotation_deg: float
    count: int

    @property
    def is_tolerable(self) -> bool:
        """Both are the same path."""
        return (
            self.center_share < MAX_DISAGREEMENT
            and self.rotation_deg < MAX_ROTATION_DISAGREEMENT_DEG
        )


NOT_COMPARED = PathDisagreement(center_share=float("inf"), rotation_deg=180.0, count=0)


def compare_paths(
    rotations_a: FloatArray, centers_a: FloatArray, rotations_b: FloatArray, centers_b: FloatArray
) -> PathDisagreement:
    """Aligns by the mean rotation, which a straight path leaves free, then scale and shift.

    Args:
        rotations_a: (N, 3, 3) cam_from_world of one solution.
        centers_a: (N, 3) its camera centres.
        rotations_b: (N, 3, 3) of the other.
        centers_b: (N, 3) of the other.
    """
    n = len(centers_a)
    if n < 2:
        return NOT_COMPARED
    b_from_a = Rotation.from_matrix(np.swapaxes(rotations_b, 1, 2) @ rotations_a)
    mean = _median_rotation(b_from_a)
    angles = (mean.inv() * b_from_a).magnitude()
    a = mean.apply(centers_a - centers_a.mean(axis=0))
    b = centers_b - centers_b.mean(axis=0)
    scale = float((a * b).sum() / max((a * a).sum(), 1e-300))
    offsets = scale * a - b
    distances = np.linalg.norm(offsets - np.median(offsets, axis=0), axis=1)
    spread = float(np.sqrt((b**2).sum(axis=1).mean()))
    return PathDisagreement(
        center_share=float(np.median(distances)) / max(spread, 1e-300),
        rotation_deg=float(np.degrees(np.median(angles))),
        count=n,
    )


def _median_rotation(rotations: Rotation) -> Rotation:
    """L1 mean of rotations by reweighting (Weiszfeld; Hartley et al., CVPR 2011)."""
    mean = rotations.mean()
    for _ in range(10):
        angles = (mean.inv() * rotations).magnitude()
        mean = rotations.mean(weights=1 / np.maximum(angles, 1e-4))
    return mean


def path_roughness(centers: FloatArray, indices: IntArray) -> float:
    """How jagged a path is: median bend of a step over the median step.

    About 1.7 for a random scatter, well below 1 for a camera that is carried. NaN where fewer than
    five centres are too few to measure it.

    Args:
        centers: (N, 3) in order of time.
        indices: (N,) times or frame indices; uneven spacing is allowed for.
    """
    if len(centers) < 5:
        return float("nan")
    gaps = np.diff(indices)[:, None].astype(float)
    between = (centers[:-2] * gaps[1:] + centers[2:] * gaps[:-1]) / (gaps[1:] + gaps[:-1])
    bends = np.linalg.norm(centers[1:-1] - between, axis=1) * 2
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    return float(np.median(bends) / max(float(np.median(steps)), 1e-300))


def epipolar_support(
    pairs: Sequence[MatchedPair],
    camera: pycolmap.Camera,
    poses: dict[int, pycolmap.Rigid3d],
) -> float:
    """Share of verified matches that the poses explain, averaged over pairs.

    Reprojection errors are measured on what a solution kept; this counts what it threw away.

    Args:
        pairs: Verified pairs.
        camera: The estimated camera.
        poses: cam_from_world of each registered row.
    """
    shares = []
    for pair in pairs:
        if pair.first not in poses or pair.second not in poses:
            continue
        second_from_first = poses[pair.second] * poses[pair.first].inverse()
        essential = pycolmap.essential_matrix_from_pose(second_from_first)
        rays = [np.asarray(camera.cam_from_img(pair.pixels[:, i])) for i in (0, 1)]
        first, second = (np.concatenate([r, np.ones((len(r), 1))], axis=1) for r in rays)
        line_2, line_1 = first @ essential.T, second @ essential
        algebraic = (second * line_2).sum(axis=1) ** 2
        squared = algebraic / np.maximum(
            (line_2[:, :2] ** 2 + line_1[:, :2] ** 2).sum(axis=1), 1e-300
        )
        error_px = np.sqrt(squared) * camera.mean_focal_length()
        shares.append(float(np.mean(error_px < SUPPORT_PX)))
    return float(np.mean(shares)) if shares else 0.0


def largest_component(pairs: Sequence[MatchedPair], count: int) -> tuple[int, int]:
    """Size of the largest set of images that matches connect, and the number of sets of 3 up."""
    graph = np.zeros((count, count))
    for pair in pairs:
        if len(pair.pixels) >= MIN_POINTS_PER_IMAGE:
            graph[pair.first, pair.second] = 1
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    return int(sizes.max()), int((sizes >= 3).sum())


def check_quality(report: dict[str, Any], *, ordered: bool) -> None:
    """Raises where the numbers of a finished reconstruction do not make sense."""
    if report["points_per_image"] < MIN_POINTS_PER_IMAGE:
        raise registration_error(
            RegistrationFailure.LOW_TEXTURE,
            f"{report['points_per_image']:.0f} points in a typical image",
        )
    if report["triangulation_angle_deg"] < MIN_ANGLE_DEG:
        raise registration_error(
            RegistrationFailure.PURE_ROTATION,
            f"points are seen under {report['triangulation_angle_deg']:.2f} degrees only",
        )
    if ordered and report["roughness"] > MAX_ROUGHNESS:
        raise registration_error(
            RegistrationFailure.IMPLAUSIBLE_POSES,
            f"the path zigzags (roughness {report['roughness']:.1f})",
        )
