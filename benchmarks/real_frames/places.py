"""Where a plume is put before a recording."""

from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.pipeline.files import RunFiles
from locate.pipeline.points import load_points
from locate.recording import KeyFrames
from locate.simulation.photo_set import PhotoSet
from locate.simulation.scene import ImageBlock, PlumeSpec, Scene, VideoBlock

DEPTH_SHARES = (0.4, 0.85, 0.5, 0.8, 0.6, 0.75)
"""How far on the way to the background each place lies: far before it and near it by turns."""
RANGE_M = 8.5
"""Of a plume from the middle camera, as in the simulated plants; a free scale is set to it."""
CENTRAL = 0.25
"""How far from the middle of the frame the background of a place may lie, share of its sides."""
LOW = 0.1
"""How much lower than the middle a source stands at least, so that the plume is in the frame."""
FPS = 30.0
"""Of the recordings, which are folders without times."""
FIRST_SEED = 640_000


class NoPosesError(Exception):
    """The run on a recording left no poses to place a plume by; says why."""


def posed_photos(run: Path) -> PhotoSet:
    """The frames of a finished run with its poses and points, in the world of its map.

    Raises:
        NoPosesError: The camera stood still, or nothing was reconstructed.
    """
    files = RunFiles(run)
    points = load_points(files.points) if files.trajectory.exists() else None
    if points is None:
        raise NoPosesError("the run on it found no poses: no plume can be placed")
    trajectory = Trajectory.load(files.trajectory)
    names = dict(zip(*_indexed(KeyFrames.load(files.frame_index)), strict=True))
    return PhotoSet(
        paths=tuple(files.frames / names[i] for i in trajectory.indices.tolist()),
        trajectory=renumbered(trajectory),
        points_in_world=points,
        target_from_photos=Similarity(scale=1.0, rotation=np.eye(3), translation=np.zeros(3)),
    )


def _indexed(frames: KeyFrames) -> tuple[list[int], list[str]]:
    return frames.indices.tolist(), frames.names


def renumbered(trajectory: Trajectory) -> Trajectory:
    """The poses as those of frames 0, 1, ... at `FPS`; their covariance is not the truth's."""
    numbers = np.arange(len(trajectory))
    return Trajectory(
        camera=trajectory.camera,
        indices=numbers,
        times_s=numbers / FPS,
        rotations=trajectory.rotations,
        translations=trajectory.translations,
        metric=trajectory.metric,
        gravity=trajectory.gravity,
    )


def put_plume(photos: PhotoSet, place: int) -> tuple[PhotoSet, Scene]:
    """The photos in a world of the right size, and the plume in it.

    Args:
        photos: With sparse points.
        place: Its number, which is the seed of everything.
    """
    rng = np.random.default_rng([FIRST_SEED + place, 61])
    source = draw_source(photos, place, rng)
    photos, source = _scaled(photos, source)
    exit_ = np.random.default_rng([FIRST_SEED + place, 62])
    plume = PlumeSpec(
        source=(float(source[0]), float(source[1]), float(source[2])),
        radius_m=exit_.uniform(0.1, 0.17),
        height_m=exit_.uniform(3.0, 4.0),
        temperature_k=exit_.uniform(360, 500),
        flow_seed=FIRST_SEED + place,
    )
    return photos, Scene(
        seed=FIRST_SEED + place,
        video=VideoBlock(frames=len(photos.paths), fps=FPS),
        image=ImageBlock(noise=0.0),
        plumes=(plume,),
    )


def draw_source(photos: PhotoSet, place: int, rng: np.random.Generator) -> FloatArray:
    """(3,) before a random point that the middle frame shows below its middle."""
    trajectory = photos.trajectory
    i = len(trajectory) // 2
    size = np.array([trajectory.camera.width, trajectory.camera.height])
    off = np.nan_to_num(trajectory.project(i, photos.points_in_world) / size - 0.5, nan=np.inf)
    wanted = (np.abs(off[:, 0]) <= CENTRAL) & (off[:, 1] >= LOW) & (off[:, 1] <= LOW + CENTRAL)
    if not wanted.any():
        wanted = np.abs(off).max(axis=1) <= max(CENTRAL, float(np.abs(off).max(axis=1).min()))
    point = photos.points_in_world[rng.choice(np.flatnonzero(wanted))]
    center = trajectory.centers_in_world[i]
    return np.asarray(center + DEPTH_SHARES[place] * (point - center))


def _scaled(photos: PhotoSet, source: FloatArray) -> tuple[PhotoSet, FloatArray]:
    trajectory = photos.trajectory
    if trajectory.metric:
        return photos, source
    range_ = np.linalg.norm(source - trajectory.centers_in_world[len(trajectory) // 2])
    grown = Similarity(scale=float(RANGE_M / range_), rotation=np.eye(3), translation=np.zeros(3))
    scaled = PhotoSet(
        paths=photos.paths,
        trajectory=trajectory.transformed(grown),
        points_in_world=grown(photos.points_in_world),
        target_from_photos=photos.target_from_photos,
    )
    return scaled, grown(source)
