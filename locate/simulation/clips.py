"""Training clips for the learned registered detector, of simulated plants and of photos."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from detect.detection import Frames
from detect.learning.clips import Leaks, TrainingClip
from detect.registered.detector import RegisteredDetector, displacement_sigma
from detect.registered.features import stack_features
from detect.synthesis.sample import log_uniform
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.recording.spacing import spread_key_rows
from locate.simulation.capture import CaptureSetup, RenderedFrames, render_frames
from locate.simulation.capture_degradation import DEGRADED_POSE_ERROR_DEG as ROUGH_ERROR_DEG
from locate.simulation.capture_degradation import degrade_capture
from locate.simulation.compression import draw_video_coding
from locate.simulation.layouts import random_scene
from locate.simulation.nuisances import apply_nuisances
from locate.simulation.photo_scenes import make_photo_capture
from locate.simulation.randomised_sources import randomise_sources
from locate.simulation.scene import CameraBlock, PathBlock, Scene

CLIP_FRAMES = 24
UNUSED_END_FRAMES = 4
KEY_FRAMES = 8
PLUME_FREE_SHARE = 0.35
AMPLITUDE_PX = (0.06, 2.0)
NOISE_LEVELS = (0.4, 4.0)
DEGRADED_POSE_ERROR_DEG = (0.003, 0.1)
SHIFT_M_PER_DEG = 0.15
SIDE_PX = (320, 240)
FOCAL_PX = (250.0, 600.0)


def draw_clip_scene(seed: int, *, leaks: Leaks = "nozzle", plume: bool | None = None) -> Scene:
    """A random plant in a short recording: arc, hand or lawn-mower; weak to strong, or no plume.

    Args:
        seed: Of everything.
        leaks: Where plumes leave.
        plume: Whether there is one; None leaves that to the seed.
    """
    if leaks == "anywhere":
        amplitude_px = log_uniform(np.random.default_rng([seed, 17]), AMPLITUDE_PX)
        return randomise_sources(draw_clip_scene(seed, plume=False), amplitude_px, plume=plume)
    rng = np.random.default_rng([seed, 12])
    drawn = bool(rng.random() > PLUME_FREE_SHARE)
    scene = random_scene(
        seed,
        plume=drawn if plume is None else plume,
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        noise=log_uniform(rng, NOISE_LEVELS),
        frames=CLIP_FRAMES,
        arc_deg=float(rng.uniform(14, 40)),
    )
    camera = CameraBlock(width=SIDE_PX[0], height=SIDE_PX[1], focal_px=log_uniform(rng, FOCAL_PX))
    return scene.model_copy(update={"camera": camera, "path": _draw_path(rng, scene.path)})


def make_clip(seed: int, leaks: Leaks = "nozzle", *, coded: bool = False) -> TrainingClip:
    """Renders the scene of that seed and measures its key frames, poses a little wrong.

    Args:
        seed: Of everything.
        leaks: Where plumes leave.
        coded: Whether it is stored as a video of few bits.
    """
    scene = draw_clip_scene(seed, leaks=leaks)
    capture = _store(CaptureSetup(scene=scene), coded=coded)
    return measure_clip(render_frames(capture), scene.random_stream(13))


def make_photo_clip(
    seed: int,
    photos: Sequence[Path],
    *,
    leaks: Leaks = "nozzle",
    plume: bool | None = None,
    nuisances: Sequence[str] = (),
    rough: bool = False,
    coded: bool = False,
) -> TrainingClip:
    """A training clip before photos.

    Args:
        seed: Of everything.
        photos: To draw from; of one split.
        leaks: Where plumes leave.
        plume: Whether there is one; None leaves that to the seed.
        nuisances: Their names.
        rough: Whether it is filmed as `degrade_capture` does it, its poses worse.
        coded: Whether it is stored as a video of few bits, whatever the nuisances say.
    """
    scene = draw_clip_scene(seed, leaks=leaks, plume=plume)
    capture = make_photo_capture(scene, photos)
    if rough:
        error_deg = log_uniform(scene.random_stream(27), ROUGH_ERROR_DEG)
        spoilt = degrade_capture(capture)
    else:
        error_deg = None
        spoilt = apply_nuisances(capture, nuisances, scene.random_stream(24))
    rendered = render_frames(_store(spoilt, coded=coded))
    return measure_clip(rendered, scene.random_stream(13), error_deg)


def measure_clip(
    rendered: RenderedFrames, rng: np.random.Generator, error_deg: float | None = None
) -> TrainingClip:
    """Measures key frames of a recording, its poses a little wrong (see `perturb_poses`)."""
    poses = perturb_poses(rendered.trajectory, rng, error_deg)
    frames = Frames(images=rendered.images, trajectory=poses, b_frames=rendered.b_frames)
    keys = spread_key_rows(
        len(frames), KEY_FRAMES, ends=UNUSED_END_FRAMES, b_frames=frames.b_frames
    )
    return build_clip(frames, rendered, keys.tolist())


def build_clip(frames: Frames, rendered: RenderedFrames, keys: Sequence[int]) -> TrainingClip:
    """What is measured of those frames that can be, beside the truth.

    Raises:
        BadInputError: None can.
    """
    detector = RegisteredDetector()
    measured = [(rendered.truths[key], detector.measure(frames, key)) for key in keys]
    known = [(truth, answer[0]) for truth, answer in measured if answer is not None]
    if not known:
        raise BadInputError("none of the key frames can be measured: no neighbour sees the same")
    return TrainingClip(
        inputs=np.stack([stack_features(m, displacement_sigma(m)) for _, m in known]).astype(
            np.float16
        ),
        displacements=np.stack([t.displacement for t, _ in known]).astype(np.float16),
        surface=np.stack([np.isfinite(t.depth) for t, _ in known]),
        amplitude_px=rendered.amplitude_px,
    )


def perturb_poses(
    trajectory: Trajectory, rng: np.random.Generator, error_deg: float | None = None
) -> Trajectory:
    """Independent errors of every pose, as structure from motion makes them.

    Args:
        trajectory: The true poses.
        rng: Draws them.
        error_deg: Standard deviation about every axis; None draws that too.
    """
    error_deg = log_uniform(rng, DEGRADED_POSE_ERROR_DEG) if error_deg is None else error_deg
    turns = Rotation.from_rotvec(rng.normal(0, np.radians(error_deg), (len(trajectory), 3)))
    rotations = turns.as_matrix() @ trajectory.rotations
    shifts_m = rng.normal(0, error_deg * SHIFT_M_PER_DEG, (len(trajectory), 3))
    centers = trajectory.centers_in_world + shifts_m
    translations = -np.einsum("nij,nj->ni", rotations, centers)
    return replace(trajectory, rotations=rotations, translations=translations)


def _store(capture: CaptureSetup, *, coded: bool) -> CaptureSetup:
    if not coded:
        return capture
    return replace(capture, coding=draw_video_coding(capture.scene.random_stream(28)))


def _draw_path(rng: np.random.Generator, orbit: PathBlock) -> PathBlock:
    """The orbit of the scene, walked by hand, or lanes above it."""
    match rng.choice(["orbit", "handheld", "lawn_mower"], p=[0.45, 0.35, 0.2]):
        case "handheld":
            changes = {"kind": "handheld", "jitter_m": rng.uniform(0.02, 0.06), "jitter_deg": 0.5}
        case "lawn_mower":
            changes = {
                "kind": "lawn_mower",
                "height_m": rng.uniform(5.0, 8.0),
                "lanes": 1,
                "length_m": rng.uniform(2.5, 5.0),
                "pitch_deg": rng.uniform(35, 60),
            }
        case _:
            changes = {}
    return orbit.model_copy(update=changes)
