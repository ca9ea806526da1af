"""Scenes of photos: walls, ground and cut-outs at several depths, with a plume before them.

Photos bring what plants made of planes and cylinders lack: foliage, water, fur, faces, print.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from detect.synthesis.sample import log_uniform
from locate.simulation.billboards import Billboard, lay_billboard, stand_billboard
from locate.simulation.capture import CaptureSetup
from locate.simulation.outlines import bush_outline, patch_outline
from locate.simulation.scene import PlumeSpec, Scene

PHOTOS_PER_SCENE = 6
TEXEL_SHARE = (0.35, 1.2)
"""Width of a photo's pixel over that of a camera's pixel where the plume is."""
SCENES_PER_FLOW = 10


def make_photo_capture(scene: Scene, photos: Sequence[Path]) -> CaptureSetup:
    """The camera and the plume of a scene, amid photos instead of its objects.

    Args:
        scene: Its path looks across the origin towards y, or down.
        photos: To draw a few from.
    """
    rng = scene.random_stream(22)
    chosen = tuple(photos[i] for i in rng.choice(len(photos), PHOTOS_PER_SCENE, replace=False))
    pixel_m = scene.path.radius_m / scene.camera.focal_px
    billboards = [
        *_draw_backdrop(rng, pixel_m, scene.path.kind == "lawn_mower"),
        *_draw_cut_outs(rng, pixel_m),
    ]
    plumes = tuple(_share_flow(plume, scene.seed // SCENES_PER_FLOW) for plume in scene.plumes)
    scene = scene.model_copy(update={"objects": (), "plumes": plumes})
    return CaptureSetup(scene=scene, photos=chosen, billboards=tuple(billboards))


def _draw_backdrop(rng: np.random.Generator, pixel_m: float, from_above: bool) -> list[Billboard]:
    """A wall, perhaps with a nearer one beside it, and perhaps ground."""
    far = rng.uniform(2.5, 8)
    height = rng.uniform(2.5, 6) if rng.random() < 0.35 else 100.0
    billboards = [_draw_wall(rng, pixel_m, (-60.0, far), (120.0, height))]
    if rng.random() < 0.4:
        edge, near = rng.uniform(-2, 2), rng.uniform(1.0, far)
        size = (60.0, rng.uniform(2, 8))
        start = edge if rng.random() < 0.5 else edge - size[0]
        billboards.append(_draw_wall(rng, pixel_m, (start, near), size, slant_deg=8))
    if from_above or rng.random() < 0.65:
        ground = lay_billboard(
            0.0,
            0.0,
            rng.uniform(-0.6, 0.2),
            photo=int(rng.integers(PHOTOS_PER_SCENE)),
            texel_m=pixel_m * log_uniform(rng, TEXEL_SHARE),
        )
        billboards.append(ground)
    return billboards


def _draw_wall(
    rng: np.random.Generator,
    pixel_m: float,
    start: tuple[float, float],
    size_m: tuple[float, float],
    slant_deg: float = 25.0,
) -> Billboard:
    """A wall through the start's y where x is 0, turned there."""
    yaw_deg = rng.uniform(-slant_deg, slant_deg)
    x, y = start[0], start[1] + start[0] * np.tan(np.radians(yaw_deg))
    return stand_billboard(
        x,
        y,
        -2.0,
        yaw_deg,
        size_m=(size_m[0], size_m[1] + 2),
        photo=int(rng.integers(PHOTOS_PER_SCENE)),
        texel_m=1.3 * pixel_m * log_uniform(rng, TEXEL_SHARE),
    )


def _draw_cut_outs(rng: np.random.Generator, pixel_m: float) -> list[Billboard]:
    """Up to eight posters, patches, bushes and posts, before and behind the plume."""
    billboards = []
    for _ in range(rng.integers(0, 9)):
        cover = (None, patch_outline(rng), bush_outline(rng), None)[rng.integers(4)]
        width, height = rng.uniform(0.4, 3.0, 2)
        if cover is None and rng.random() < 0.5:
            width, height = rng.uniform(0.08, 0.3), rng.uniform(2, 6)
        x, y, z = rng.uniform(-6, 5), rng.uniform(-3.5, 6), rng.uniform(-0.4, 2.5)
        if abs(y) < 0.5:
            y += np.sign(y)
        billboard = stand_billboard(
            x,
            y,
            z,
            rng.uniform(-50, 50),
            size_m=(width, height),
            photo=int(rng.integers(PHOTOS_PER_SCENE)),
            texel_m=pixel_m * log_uniform(rng, TEXEL_SHARE),
            cover=cover,
        )
        billboards.append(billboard)
    return billboards


def _share_flow(plume: PlumeSpec, flow_seed: int) -> PlumeSpec:
    """The plume with a flow that several scenes share, as it costs more than all the rest."""
    if plume.flow_seed is not None:
        return plume
    rng = np.random.default_rng([flow_seed, 23])
    shape = {
        "radius_m": rng.uniform(0.1, 0.17),
        "height_m": rng.uniform(3.0, 4.0),
        "temperature_k": rng.uniform(360, 500),
    }
    return plume.model_copy(update={**shape, "flow_seed": flow_seed})
