"""Lessons of real photos with known poses: as they are, or with plumes rendered onto them."""

from dataclasses import replace

import numpy as np

from detect.detection import Frames
from detect.registered.lessons import Lesson
from detect.synthesis.sample import log_uniform
from detect.warp import sample
from geometry.arrays import FloatArray, GreyImage
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.images import bending
from locate.simulation.filming import Footage
from locate.simulation.lessons import AMPLITUDE_PX, KEY_FRAMES, SIDE_PX, lesson_of
from locate.simulation.onto import OntoRenderer, displace, output_trajectory
from locate.simulation.photos import PhotoSet
from locate.simulation.plume import PlumeField
from locate.simulation.scene import ImageBlock, Plume, Scene, VideoBlock

PLUME_FREE = 0.4
NOISE = (0.3, 2.0)
RANGE_M = (8.0, 14.0)
"""How far away the middle of the first photo is taken to be."""
DEPTH_SHARE = (0.35, 0.7)
"""Where on the way to the surface the plume stands."""
PHOTOS_A_SECOND = 5.0
LEAST_FACTOR = 2
ONE_FINER = 0.3
"""How often a photo is reduced by one less than it could be for a frame of a lesson's size."""


def make_set_lesson(photos: PhotoSet, seed: int, *, flow_seed: int = 0) -> Lesson:
    """A lesson of a photo set.

    Args:
        photos: The set; poses of its own structure from motion are errors enough.
        seed: Of everything but the flow.
        flow_seed: Of the flow, which costs most and may serve several lessons.
    """
    rng = np.random.default_rng([seed, 31])
    photos = _scaled(photos, rng)
    most = min(n // side for n, side in zip(_size(photos.trajectory), SIDE_PX, strict=True))
    factor = max(LEAST_FACTOR, most - int(rng.random() < ONE_FINER))
    trajectory = output_trajectory(photos.trajectory, factor, PHOTOS_A_SECOND)
    scene = Scene(
        seed=seed,
        video=VideoBlock(frames=len(photos.paths), fps=PHOTOS_A_SECOND),
        image=ImageBlock(noise=log_uniform(rng, NOISE)),
        plumes=() if rng.random() < PLUME_FREE else (_plume(photos, trajectory, rng, flow_seed),),
    )
    footage = _filmed(scene, photos, trajectory, factor)
    frames = Frames(images=footage.images, trajectory=footage.trajectory)
    keys = rng.choice(len(frames), min(KEY_FRAMES, len(frames)), replace=False)
    return _cropped(lesson_of(frames, footage, sorted(int(key) for key in keys)), rng)


def _filmed(scene: Scene, photos: PhotoSet, trajectory: Trajectory, factor: int) -> Footage:
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = OntoRenderer(trajectory, photos, fields)
    truths = [renderer.truth(i) for i in range(len(trajectory))]
    images = [
        displace(_straight(photos, i), truth.displacement, factor, scene.image, scene.random(4, i))
        for i, truth in enumerate(truths)
    ]
    amplitude_px = max(renderer.amplitudes_px, default=0.0)
    return Footage(images=images, truths=truths, trajectory=trajectory, amplitude_px=amplitude_px)


def _straight(photos: PhotoSet, i: int) -> GreyImage:
    """Photo `i` as the undistorted camera would have taken it."""
    places = bending(photos.trajectory.camera)
    image = photos.image(i)
    return image if places is None else np.rint(sample(image, places)).clip(0, 255).astype(np.uint8)


def _scaled(photos: PhotoSet, rng: np.random.Generator) -> PhotoSet:
    """The set in a world where its surfaces are some ten metres away."""
    middle = len(photos.paths) // 2
    depth = np.median(photos.trajectory.world_to_cam(middle, photos.points_in_world)[:, 2])
    scale = float(rng.uniform(*RANGE_M) / depth)
    grown = Similarity(scale=scale, rotation=np.eye(3), translation=np.zeros(3))
    return replace(
        photos,
        trajectory=photos.trajectory.transformed(grown),
        points_in_world=grown(photos.points_in_world),
    )


def _plume(
    photos: PhotoSet, trajectory: Trajectory, rng: np.random.Generator, flow_seed: int
) -> Plume:
    """A leak between the camera of a middle photo and what that shows there."""
    shape = np.random.default_rng([flow_seed, 32])
    count = len(trajectory)
    i = int(rng.integers(count // 4, count - count // 4))
    source = _place(photos.points_in_world, trajectory, i, rng)
    return Plume(
        source=(float(source[0]), float(source[1]), float(source[2])),
        radius_m=shape.uniform(0.1, 0.17),
        height_m=shape.uniform(3.0, 4.0),
        temperature_k=shape.uniform(360, 500),
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        flow_seed=flow_seed,
    )


def _place(
    points_in_world: FloatArray, trajectory: Trajectory, i: int, rng: np.random.Generator
) -> FloatArray:
    """(3,) in front of a random one of the points in the middle of frame `i`."""
    pixels = trajectory.project(i, points_in_world)
    size = np.array(_size(trajectory))
    central = ((pixels > 0.25 * size) & (pixels < 0.75 * size)).all(axis=1)
    point = points_in_world[rng.choice(np.flatnonzero(central))]
    center = trajectory.centers_in_world[i]
    return np.asarray(center + rng.uniform(*DEPTH_SHARE) * (point - center))


def _cropped(lesson: Lesson, rng: np.random.Generator) -> Lesson:
    """A window of the size of other lessons, with as much plume as one of a few tries has."""
    width, height = SIDE_PX
    size = np.abs(lesson.displacements).max(axis=-1).astype(np.float32)
    spare_y, spare_x = size.shape[1] - height, size.shape[2] - width

    def share(corner: tuple[int, int]) -> float:
        y, x = corner
        return float(size[:, y : y + height, x : x + width].sum())

    tries = [(int(rng.integers(spare_y + 1)), int(rng.integers(spare_x + 1))) for _ in range(4)]
    y, x = max(tries, key=share)
    window = (slice(y, y + height), slice(x, x + width))
    return Lesson(
        inputs=lesson.inputs[:, :, *window],
        displacements=lesson.displacements[:, *window],
        surface=lesson.surface[:, *window],
        amplitude_px=lesson.amplitude_px,
    )


def _size(trajectory: Trajectory) -> tuple[int, int]:
    return trajectory.camera.width, trajectory.camera.height
