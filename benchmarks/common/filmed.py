"""A scene filmed from a moving camera, and what is measured of its key frames; kept in a file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from detect.detection import Frames
from detect.information import DisplacementInformation
from detect.registered import RegisteredDetector
from detect.registered.registration import Measurement
from geometry.arrays import BoolArray, FloatArray, FloatMap
from geometry.npz import open_arrays, save_arrays
from geometry.trajectory import Trajectory
from locate.recording.spacing import spread_key_rows
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.capture import CaptureSetup, render_frames
from locate.simulation.clips import UNUSED_END_FRAMES, perturb_poses
from locate.simulation.scene import Scene
from locate.simulation.writer import LARGEST_HALF

POSE_ERROR_DEG = 0.03
STILL_PX, PLUME_SHARE = 0.01, 0.3
FOUND_SHARE = 0.15
MEASURED_MAPS = tuple(name for name in Measurement.__dataclass_fields__ if name != "information")


def record(capture: CaptureSetup, count: int, path: Path) -> None:
    """Renders a take and writes `count` key frames, what was measured of them, and the truth."""
    rendered = render_frames(capture)
    given = perturb_poses(rendered.trajectory, capture.scene.random_stream(13), POSE_ERROR_DEG)
    frames = Frames(images=rendered.images, trajectory=given, b_frames=rendered.b_frames)
    detector = RegisteredDetector()
    keys = spread_key_rows(len(frames), count, ends=UNUSED_END_FRAMES, b_frames=frames.b_frames)
    measured = [(key, detector.measure(frames, key)) for key in keys.tolist()]
    known = [(key, *answer) for key, answer in measured if answer is not None]
    arrays = {
        name: np.stack([getattr(m, name) for _, m, _ in known]).clip(-LARGEST_HALF, LARGEST_HALF)
        for name in MEASURED_MAPS
    }
    truths = [rendered.truths[key] for key, _, _ in known]
    information = [m.information for _, m, _ in known if m.information is not None]
    save_arrays(
        path,
        keys=np.array([key for key, _, _ in known]),
        inverse_depth_units=np.array([unit for _, _, unit in known]),
        images=np.stack([rendered.images[key] for key, _, _ in known]),
        truth=np.stack([t.displacement for t in truths]).astype(np.float16),
        surface=np.stack([np.isfinite(t.depth) for t in truths]),
        information_vector=np.stack([each.vector for each in information]),
        information_matrix=np.stack([each.matrix for each in information]),
        **{name: map_.astype(np.float16) for name, map_ in arrays.items()},
    )


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What `record` wrote, and the poses that the detector is given, of the key frames."""

    images: np.ndarray
    measurements: list[Measurement]
    inverse_depth_units: FloatArray
    truth: FloatMap
    surface: BoolArray
    trajectory: Trajectory
    scene: Scene

    @classmethod
    def load(cls, path: Path, capture: CaptureSetup) -> "Recorded":
        with open_arrays(path, "a filmed sequence") as file:
            maps = {n: file[n].astype(np.float32) for n in MEASURED_MAPS}
            count = len(file["keys"])
            vector, matrix = file["information_vector"], file["information_matrix"]
            block = capture.scene.camera
            focal_px = block.focal_px * capture.focal_factor
            camera = block.model_copy(update={"radial": 0.0, "focal_px": focal_px})
            true = replace(simulate_trajectory(capture.scene), camera=camera.build())
            return cls(
                images=file["images"],
                measurements=[
                    Measurement(
                        **{name: map_[k] for name, map_ in maps.items()},
                        information=DisplacementInformation(vector=vector[k], matrix=matrix[k]),
                    )
                    for k in range(count)
                ],
                inverse_depth_units=file["inverse_depth_units"],
                truth=file["truth"].astype(np.float32),
                surface=file["surface"],
                trajectory=perturb_poses(
                    true, capture.scene.random_stream(13), POSE_ERROR_DEG
                ).take(file["keys"]),
                scene=capture.scene,
            )


def labels(sequence: Recorded, rows: Sequence[int]) -> tuple[BoolArray, BoolArray]:
    """(K, H, W) plume, and which pixels count."""
    size = np.linalg.norm(sequence.truth[rows], axis=-1)
    amplitude_px = max((p.amplitude_px or 0.0 for p in sequence.scene.plumes), default=0.0)
    positive = size > max(PLUME_SHARE * amplitude_px, STILL_PX)
    surface = sequence.surface[rows]
    return positive & surface, surface & (positive | (size < STILL_PX))
