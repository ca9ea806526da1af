"""What the learned registered detector learns from: features of simulated frames, and the truth."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from detect.detection import Frames
from detect.registered.detector import RegisteredDetector, displacement_sigma
from detect.registered.features import features
from detect.synthesis.archive import open_arrays, save_arrays
from detect.synthesis.sample import log_uniform
from geometry.arrays import BoolArray
from geometry.trajectory import Trajectory
from locate.simulation.layouts import random_scene
from locate.simulation.paths import fly
from locate.simulation.plume import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import CameraBlock, PathBlock, Scene
from locate.simulation.world import World

FRAMES = 24
ENDS = 4
KEY_FRAMES = 8
PLUME_FREE = 0.35
AMPLITUDE_PX = (0.06, 2.0)
NOISE = (0.4, 4.0)
POSE_ERROR_DEG = (0.003, 0.1)
SHIFT_M_PER_DEG = 0.15
SIDE_PX = (320, 240)
FOCAL_PX = (250.0, 600.0)


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """K key frames of one scene.

    Attributes:
        inputs: (K, C, H, W) float16, the channels of `detect.registered.features`.
        displacements: (K, H, W, 2) float16, px, true.
        surface: (K, H, W) false in the sky, where nothing can be displaced.
        amplitude_px: 95th percentile of |w| over the plume; 0 without one.
    """

    inputs: NDArray[np.float16]
    displacements: NDArray[np.float16]
    surface: BoolArray
    amplitude_px: float

    def save(self, path: Path) -> None:
        """Writes all or nothing."""
        save_arrays(
            path,
            inputs=self.inputs,
            displacements=self.displacements,
            surface=np.packbits(self.surface, axis=-1),
            amplitude_px=np.array(self.amplitude_px),
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing or broken.
        """
        with open_arrays(path, "a lesson") as file:
            inputs = file["inputs"]
            surface = np.unpackbits(file["surface"], axis=-1, count=inputs.shape[-1])
            return cls(
                inputs=inputs,
                displacements=file["displacements"],
                surface=surface.astype(bool),
                amplitude_px=float(file["amplitude_px"]),
            )


def lesson_scene(seed: int) -> Scene:
    """A random plant in a short recording: arc, hand or lawn-mower; weak to strong, or no plume."""
    rng = np.random.default_rng([seed, 12])
    scene = random_scene(
        seed,
        plume=bool(rng.random() > PLUME_FREE),
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        noise=log_uniform(rng, NOISE),
        frames=FRAMES,
        arc_deg=float(rng.uniform(14, 40)),
    )
    camera = CameraBlock(width=SIDE_PX[0], height=SIDE_PX[1], focal_px=log_uniform(rng, FOCAL_PX))
    return scene.model_copy(update={"camera": camera, "path": _path(rng, scene.path)})


def make_lesson(seed: int) -> Lesson:
    """Renders the scene of that seed and measures its key frames, poses a little wrong."""
    scene = lesson_scene(seed)
    trajectory = fly(scene)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = Renderer(scene, World(scene), fields, trajectory)
    rendered = [renderer.render(i) for i in range(len(trajectory))]
    frames = Frames(
        images=[image for image, _ in rendered],
        trajectory=_disturbed(trajectory, scene.random(13)),
    )
    detector = RegisteredDetector()
    keys = np.linspace(ENDS, FRAMES - 1 - ENDS, KEY_FRAMES).round().astype(int)
    measured = {int(key): detector.measure(frames, int(key)) for key in keys}
    known = [(rendered[key][1], told[0]) for key, told in measured.items() if told is not None]
    return Lesson(
        inputs=np.stack([features(m, displacement_sigma(m)) for _, m in known]).astype(np.float16),
        displacements=np.stack([t.displacement for t, _ in known]).astype(np.float16),
        surface=np.stack([np.isfinite(t.depth) for t, _ in known]),
        amplitude_px=max(renderer.amplitudes_px, default=0.0),
    )


def _path(rng: np.random.Generator, orbit: PathBlock) -> PathBlock:
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


def _disturbed(trajectory: Trajectory, rng: np.random.Generator) -> Trajectory:
    """Independent errors of every pose, as structure from motion makes them."""
    error_deg = log_uniform(rng, POSE_ERROR_DEG)
    turns = Rotation.from_rotvec(rng.normal(0, np.radians(error_deg), (len(trajectory), 3)))
    rotations = turns.as_matrix() @ trajectory.rotations
    shifts_m = rng.normal(0, error_deg * SHIFT_M_PER_DEG, (len(trajectory), 3))
    centers = trajectory.centers_in_world + shifts_m
    translations = -np.einsum("nij,nj->ni", rotations, centers)
    return replace(trajectory, rotations=rotations, translations=translations)
