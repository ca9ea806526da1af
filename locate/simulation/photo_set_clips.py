"""Training clips of real photos with known poses, as they are or with plumes rendered on."""

from dataclasses import replace

import numpy as np

from detect.detection import Frames
from detect.learning.clips import TrainingClip
from detect.synthesis.sample import log_uniform
from detect.warp import sample
from geometry.arrays import FloatArray, GreyImage
from geometry.errors import BadInputError
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory
from locate.recording.images import distortion_map
from locate.simulation.capture import RenderedFrames
from locate.simulation.clips import AMPLITUDE_PX, KEY_FRAMES, SIDE_PX, build_clip
from locate.simulation.photo_overlay import OverlayRenderer, displace_photo, output_trajectory
from locate.simulation.photo_set import PhotoSet
from locate.simulation.plume_field import PlumeField
from locate.simulation.scene import ImageBlock, PlumeSpec, Scene, VideoBlock

PLUME_FREE_SHARE = 0.4
NOISE = (0.3, 2.0)
RANGE_M = (8.0, 14.0)
"""How far away the middle of the first photo is taken to be."""
DEPTH_SHARE = (0.35, 0.7)
"""Where on the way to the surface the plume is."""
PHOTOS_A_SECOND = 5.0
LEAST_FACTOR = 2
FINER_SHARE = 0.3
"""How often a photo is reduced by one less than it could be for a frame of a clip's size."""
UNREDUCED_SHARE = 0.6
"""How many of the sets without a plume are not reduced."""
WINDOW_TRIES, WINDOWS = 6, 3
CENTRAL_SHARE = 0.25


def make_photo_set_clip(photos: PhotoSet, seed: int, *, flow_seed: int = 0) -> TrainingClip:
    """A training clip of a photo set: several windows of each of its key frames.

    Args:
        photos: The set; poses of its own structure from motion are errors enough.
        seed: Of everything but the flow.
        flow_seed: Of the flow, which costs most; several clips may share one.

    Raises:
        BadInputError: The set has no sparse points, which say where its surfaces are.
    """
    if not len(photos.points_in_world):
        raise BadInputError(
            f"{photos.paths[0].parent}: its poses come without sparse points; give a COLMAP model"
        )
    rng = np.random.default_rng([seed, 31])
    photos = _scale_set(photos, rng)
    most = min(n // side for n, side in zip(_image_size(photos.trajectory), SIDE_PX, strict=True))
    factor = max(LEAST_FACTOR, most - int(rng.random() < FINER_SHARE))
    plume_free = rng.random() < PLUME_FREE_SHARE
    if plume_free and rng.random() < UNREDUCED_SHARE:
        factor = 1
    trajectory = output_trajectory(photos.trajectory, factor, PHOTOS_A_SECOND)
    scene = Scene(
        seed=seed,
        video=VideoBlock(frames=len(photos.paths), fps=PHOTOS_A_SECOND),
        image=ImageBlock(noise=log_uniform(rng, NOISE)),
        plumes=() if plume_free else (_draw_plume(photos, trajectory, rng, flow_seed),),
    )
    rendered = _render_set(scene, photos, trajectory, factor)
    frames = Frames(images=rendered.images, trajectory=rendered.trajectory)
    keys = rng.choice(len(frames), min(KEY_FRAMES, len(frames)), replace=False)
    return _crop_windows(build_clip(frames, rendered, sorted(int(key) for key in keys)), rng)


def _render_set(
    scene: Scene, photos: PhotoSet, trajectory: Trajectory, factor: int
) -> RenderedFrames:
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = OverlayRenderer(trajectory, photos, fields)
    truths = [renderer.frame_truth(i) for i in range(len(trajectory))]
    images = [_undistort_photo(photos, i) for i in range(len(photos.paths))]
    if factor > 1:
        images = [
            displace_photo(
                image, truth.displacement, factor, scene.image, scene.random_stream(4, i)
            )
            for i, (image, truth) in enumerate(zip(images, truths, strict=True))
        ]
    amplitude_px = max(renderer.amplitudes_px, default=0.0)
    return RenderedFrames(
        images=images, truths=truths, trajectory=trajectory, amplitude_px=amplitude_px
    )


def _undistort_photo(photos: PhotoSet, i: int) -> GreyImage:
    """Photo `i` as the undistorted camera would have taken it."""
    places = distortion_map(photos.trajectory.camera)
    image = photos.read_image(i)
    return image if places is None else np.rint(sample(image, places)).clip(0, 255).astype(np.uint8)


def _scale_set(photos: PhotoSet, rng: np.random.Generator) -> PhotoSet:
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


def _draw_plume(
    photos: PhotoSet, trajectory: Trajectory, rng: np.random.Generator, flow_seed: int
) -> PlumeSpec:
    """A leak between the camera of a middle photo and what that shows there."""
    shape = np.random.default_rng([flow_seed, 32])
    count = len(trajectory)
    i = int(rng.integers(count // 4, count - count // 4))
    source = _draw_source(photos.points_in_world, trajectory, i, rng)
    return PlumeSpec(
        source=(float(source[0]), float(source[1]), float(source[2])),
        radius_m=shape.uniform(0.1, 0.17),
        height_m=shape.uniform(3.0, 4.0),
        temperature_k=shape.uniform(360, 500),
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        flow_seed=flow_seed,
    )


def _draw_source(
    points_in_world: FloatArray, trajectory: Trajectory, i: int, rng: np.random.Generator
) -> FloatArray:
    """(3,) in front of a random one of the points in the middle of frame `i`, or the next to it."""
    pixels = trajectory.project(i, points_in_world)
    aside = np.nan_to_num(np.abs(pixels / _image_size(trajectory) - 0.5).max(axis=1), nan=np.inf)
    central = aside <= max(CENTRAL_SHARE, aside.min())
    point = points_in_world[rng.choice(np.flatnonzero(central))]
    center = trajectory.centers_in_world[i]
    return np.asarray(center + rng.uniform(*DEPTH_SHARE) * (point - center))


def _crop_windows(clip: TrainingClip, rng: np.random.Generator) -> TrainingClip:
    """Windows of the size of other clips, those of some random ones that have the most plume."""
    width, height = SIDE_PX
    size = np.abs(clip.displacements).max(axis=-1).astype(np.float32)
    spare_y, spare_x = size.shape[1] - height, size.shape[2] - width
    tries = np.stack(
        [
            rng.integers(spare_y + 1, size=WINDOW_TRIES),
            rng.integers(spare_x + 1, size=WINDOW_TRIES),
        ],
        axis=1,
    )
    windows = [np.s_[y : y + height, x : x + width] for y, x in tries.tolist()]
    shares = [float(size[:, *window].sum()) for window in windows]
    chosen = [windows[i] for i in np.argsort(shares)[-WINDOWS:]]
    return TrainingClip(
        inputs=np.concatenate([clip.inputs[:, :, *window] for window in chosen]),
        displacements=np.concatenate([clip.displacements[:, *window] for window in chosen]),
        surface=np.concatenate([clip.surface[:, *window] for window in chosen]),
        amplitude_px=clip.amplitude_px,
    )


def _image_size(trajectory: Trajectory) -> tuple[int, int]:
    return trajectory.camera.width, trajectory.camera.height
