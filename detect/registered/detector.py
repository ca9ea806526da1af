"""The detector for a moving camera in a textured, static scene."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from detect.detection import Detection, Frames
from detect.evidence import displacement_evidence, null_scale
from detect.registered.evidence_network import EvidenceNetwork
from detect.registered.exposure import brighten, brighten_full_size, gain_towards
from detect.registered.features import stack_features
from detect.registered.neighbours import choose_neighbours, typical_inverse_depth
from detect.registered.registration import Measurement, Neighbour, Registration
from detect.registered.separation import MOST_ONE_SIDED
from geometry.arrays import FloatArray, FloatMap
from geometry.epipolar import EpipolarGeometry
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory

ENOUGH_VISIBLE = 4.0
"""Neighbours that see a pixel, beyond which more add no trust; chosen by hand."""
EDGE_HALF_PX = 3.0
"""Depth edge at which a pixel is trusted half, px of parallax; chosen by hand."""
EDGE_SHARE, EDGE_MOST_PX = 0.1, 8.0
"""Error of w per px of a depth edge, and the largest edge that counts; chosen by hand."""
MODEL_FLOOR_PX = 0.04
"""What interpolation and small depth steps leave of w; set on simulated scenes."""
MEASURED_TEXTURE = 0.3
"""Texture below which nothing is measured, (grey levels per px) squared."""
KEY_NOISE = 1.0
"""Noise of the key frame, grey levels."""
KEY_PIXELS = 50
"""Pixels over which it is averaged: those of the window of `WINDOW_PX`, 4 pi sigma^2."""
LEAST_TEXTURE = 0.1
"""Added to the texture that it is divided by, (grey levels per px) squared."""
GAIN_ERROR = 0.3
"""Share of w that may cancel, as neighbours see through the plume too; from simulated scenes."""


class RegisteredDetector:
    """Refraction in a frame by flow against neighbours with known poses.

    The flow towards neighbour k is ``a_k rho + w - w_k``: least squares over neighbours on both
    sides of the frame separate the inverse depth rho from the displacement w, twice: on optical
    flow, then on the residual of the neighbours registered by the first answer.

    Args:
        neighbours: How many other frames to compare with; more measure more and take longer.
        points_in_world: (N, 3) sparse points of the scene, if known, for its typical depth.
            Otherwise the flow gives it.
        weights: The .onnx file of a calibrated network that evaluates the measurement; None uses
            a formula.

    Raises:
        BadInputError: The file is not such a network.
    """

    uses_other_frames = True

    def __init__(
        self,
        *,
        neighbours: int = 8,
        points_in_world: FloatArray | None = None,
        weights: Path | None = None,
    ) -> None:
        self._count = neighbours
        self._points_in_world = points_in_world
        self._network = None if weights is None else EvidenceNetwork(weights)
        self._calibration = None if self._network is None else self._network.read_calibration()
        self.response = None if self._network is None else self._network.read_response()
        self.name = "registered-plain" if self._network is None else "registered"

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index`; what looks like an error of its pose is taken out of w.

        A frame with fewer than two neighbours that overlap and show parallax has no evidence: llr
        0, sigma inf.

        Raises:
            BadInputError: The frames have no poses, poses and frames differ in number, or the
                camera shows no parallax at all.
        """
        measured = self.measure(frames, index)
        if measured is None:
            return Detection.without_evidence(frames.images[index].shape, depth=True)
        return self.to_detection(*measured)

    def to_detection(self, measurement: Measurement, inverse_depth_unit: float) -> Detection:
        """The detection a measurement supports; the unit is 1 / world unit.

        A network finds where there is refraction; how much, the measurement itself gives best.
        """
        sigma_px = displacement_sigma(measurement)
        w, texture = measurement.displacement, measurement.texture
        if self._network is None or self._calibration is None:
            trust = pixel_trust(measurement.visible, measurement.depth_edge_px)
            llr, stated_px = displacement_evidence(w, sigma_px, texture, trust)
        else:
            output = self._network.evaluate(stack_features(measurement, sigma_px))
            llr = output.llr(self._calibration)
            size_px, measured = np.hypot(w[..., 0], w[..., 1]), np.isfinite(sigma_px)
            stated_px = sigma_px * null_scale(size_px, sigma_px, texture, measured)
        return _assemble_detection(measurement, llr, stated_px, inverse_depth_unit)

    def measure(self, frames: Frames, index: int) -> tuple[Measurement, float] | None:
        """The measurement by the neighbours of frame `index`, and the unit of its inverse depth.

        None where fewer than two neighbours overlap and show parallax; raises as `detect`.
        """
        trajectory = frames.trajectory
        if trajectory is None:
            raise BadInputError("the registered detector takes camera poses; use bos without")
        if len(trajectory) != len(frames):
            raise BadInputError(f"{len(frames)} frames but {len(trajectory)} poses: give one each")
        inverse_depth = self._typical_inverse_depth(frames, trajectory, index)
        if not np.isfinite(inverse_depth):
            raise BadInputError(
                f"no frame shows parallax against frame {index}; use bos for a still camera"
            )
        rows = choose_neighbours(trajectory, index, inverse_depth, self._count, frames.b_frames)
        if len(rows) < 2:
            return None
        key = frames.images[index]
        neighbours, gains = [], {index: 1.0}
        for row in rows:
            view = EpipolarGeometry.between_frames(trajectory, index, row).in_unit(inverse_depth)
            gains[row] = gain_towards(key, frames.images[row], view)
            neighbours.append(Neighbour(image=brighten(frames.images[row], gains[row]), view=view))
        full_size = frames.full_size
        read = None if full_size is None else partial(_read_full_size, full_size, gains)
        registration = Registration(key, neighbours, read)
        return registration.measure(), inverse_depth

    def _typical_inverse_depth(self, frames: Frames, trajectory: Trajectory, index: int) -> float:
        if self._points_in_world is None:
            return typical_inverse_depth(frames, trajectory, index)
        points = trajectory.world_to_cam(index, self._points_in_world)
        pixels = trajectory.camera.project(points)
        size = (trajectory.camera.width, trajectory.camera.height)
        seen = ((pixels >= 0) & (pixels < size)).all(axis=-1)
        if not seen.any():
            return typical_inverse_depth(frames, trajectory, index)
        return float(1 / np.median(points[seen, 2]))


def _read_full_size(images: Sequence[FloatMap], gains: dict[int, float]) -> list[FloatMap]:
    """The frames of these rows, each with the gain that brings it to the key frame's brightness."""
    return [brighten_full_size(images[row], gain) for row, gain in gains.items()]


def _assemble_detection(
    measurement: Measurement, llr: FloatMap, sigma_px: FloatMap, inverse_depth_unit: float
) -> Detection:
    """What was measured, with its evidence; the unit is 1 / world unit.

    The neighbours see through the plume too, so part of w cancels: sigma grows with w. Pixels that
    are seen from one side alone have no evidence.
    """
    size_px = np.linalg.norm(measurement.displacement, axis=-1)
    known = measurement.one_sidedness < MOST_ONE_SIDED
    stated_px = np.where(known, np.hypot(sigma_px, GAIN_ERROR * size_px), np.inf)
    return Detection(
        displacement=measurement.displacement.astype(np.float32),
        sigma_px=stated_px.astype(np.float32),
        llr=np.where(known, llr, np.float32(0)),
        inverse_depth=measurement.inverse_depth(inverse_depth_unit),
        information=measurement.information,
    )


def displacement_sigma(measurement: Measurement) -> FloatMap:
    """(H, W) px: the neighbours' scatter, the key frame's noise, depth edges, and a floor.

    What is common to all neighbours their scatter does not show: the key frame's own noise, and
    what interpolation and small depth steps leave behind (the floor, set on simulated scenes).
    """
    from_scatter = measurement.scatter_px**2 * measurement.variance_factor
    from_key_noise = KEY_NOISE**2 / (KEY_PIXELS * (measurement.texture + LEAST_TEXTURE))
    from_edges = (EDGE_SHARE * np.minimum(measurement.depth_edge_px, EDGE_MOST_PX)) ** 2
    sigma_px = np.sqrt(from_scatter + from_key_noise + from_edges + MODEL_FLOOR_PX**2)
    unseen = (measurement.texture < MEASURED_TEXTURE) | (measurement.visible < 1)
    return np.where(unseen, np.inf, sigma_px).astype(np.float32)


def pixel_trust(visible: FloatMap, depth_edge_px: FloatMap) -> FloatMap:
    """(H, W) from 0 to 1: low where few neighbours see a pixel and at depth edges."""
    seen = np.clip(visible / ENOUGH_VISIBLE, 0, 1) ** 2
    smooth = 1 / (1 + (depth_edge_px / EDGE_HALF_PX) ** 2)
    return np.asarray(seen * smooth, dtype=np.float32)
