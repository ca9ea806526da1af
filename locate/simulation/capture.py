"""A capture: a scene, what comes between it and the camera, and how the camera records it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from detect.synthesis.raster import read_photo
from geometry.arrays import FloatMap, GreyImage, IntArray
from geometry.camera import Camera
from geometry.trajectory import Trajectory
from locate.simulation.billboards import Billboard, BillboardSurfaces
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.compression import FrameCoding
from locate.simulation.image_formation import GAMMA
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import RenderedTruth, Renderer
from locate.simulation.scene import Scene
from locate.simulation.shutter import INSTANT, Shutter
from locate.simulation.surfaces import StaticSurfaces, SurfaceModel
from locate.simulation.textures import TEXTURE_PX, TextureAtlas, make_noise_textures

LEAST_MEAN, MOST_GAIN = 0.2, 4.0
"""To what a dark photo is lightened, and by how much at most."""


@dataclass(frozen=True, kw_only=True)
class CaptureSetup:
    """Everything that decides a recording, and what the chain knows of its camera.

    Attributes:
        scene: The scene; `camera.radial` is a distortion that the chain does not know of.
        photos: Pictures for the billboards, in the order of their numbers.
        billboards: What is or moves in the scene beside its objects.
        shutter: How long a frame takes, and how bright it comes out.
        coding: What storing the frames does to them.
        focal_factor: Of the focal length that the chain is given, over the true one.
    """

    scene: Scene
    photos: tuple[Path, ...] = ()
    billboards: tuple[Billboard, ...] = ()
    shutter: Shutter = INSTANT
    coding: FrameCoding | None = None
    focal_factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class RenderedFrames:
    """The frames of a capture, and what is true of each.

    Attributes:
        images: N grey frames.
        truths: What is true of each.
        trajectory: The true poses, and the camera that the chain knows of.
        amplitude_px: Strength of the strongest plume; 0 without one.
        b_frames: Rows of the B frames.
    """

    images: list[GreyImage]
    truths: list[RenderedTruth]
    trajectory: Trajectory
    amplitude_px: float
    b_frames: Sequence[int] | IntArray = ()


def render_frames(capture: CaptureSetup) -> RenderedFrames:
    """Renders a capture."""
    scene = capture.scene
    trajectory = simulate_trajectory(scene)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = Renderer(scene, build_surfaces(capture), fields, trajectory, capture.shutter)
    rendered = [renderer.render_frame(i) for i in range(len(trajectory))]
    images = [image for image, _ in rendered]
    coded = None if capture.coding is None else capture.coding(images, scene.video.fps)
    return RenderedFrames(
        images=images if coded is None else coded.images,
        b_frames=() if coded is None else coded.b_frames,
        truths=[truth for _, truth in rendered],
        trajectory=replace(trajectory, camera=_stated_camera(capture)),
        amplitude_px=max(renderer.amplitudes_px, default=0.0),
    )


def make_photo_texture(path: Path, rng: np.random.Generator) -> FloatMap:
    """A random crop of a photo as radiance, mirrored into a tile without seams."""
    image = read_photo(path)
    side = TEXTURE_PX // 2
    scale = max(1.0, side / min(image.shape))
    enlarged = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    y, x = (int(rng.integers(0, n - side + 1)) for n in enlarged.shape)
    crop = enlarged[y : y + side, x : x + side][:, :: rng.choice([-1, 1])]
    light = (crop.astype(np.float32) / 255) ** GAMMA
    light *= np.clip(LEAST_MEAN / light.mean(), 1, MOST_GAIN)
    return np.pad(light[::-1], ((0, side), (0, side)), mode="symmetric")


def build_surfaces(capture: CaptureSetup) -> SurfaceModel:
    """What a ray may meet."""
    scene = capture.scene
    world = StaticSurfaces(scene)
    if not capture.billboards:
        return world
    photos = TextureAtlas(
        [
            make_photo_texture(path, scene.random_stream(20, n))
            for n, path in enumerate(capture.photos)
        ]
    )
    glints = any(billboard.gloss for billboard in capture.billboards)
    waves = TextureAtlas(make_noise_textures(scene.random_stream(21))) if glints else None
    return BillboardSurfaces(capture.billboards, photos, world, waves)


def _stated_camera(capture: CaptureSetup) -> Camera:
    block = capture.scene.camera
    stated = {"radial": 0.0, "focal_px": block.focal_px * capture.focal_factor}
    return block.model_copy(update=stated).build()
