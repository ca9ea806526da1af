"""Whether all images of a reconstruction are of one zoom, which metadata need not say.

With one camera for two zooms, nearer cameras explain the longer one: the residuals stay small, and
everything that is located is off. A camera for each image takes the zooms apart.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import pycolmap

from geometry.arrays import FloatArray, IntArray
from geometry.sfm.mapping import adjust_once

APART = 1.1
"""Least factor between the focal lengths of neighbouring zooms; a refocused lens stays below."""
FEWEST_IMAGES, FEWEST_SHARE = 3, 0.08
"""Images of a zoom, at least, and their share of all."""
TIGHT = 6.0
"""How many times narrower, as standard deviation, a zoom is than the gap to the next."""
TOLERANCE = 1e-4
"""Of the adjustment: the focal lengths are wanted to a per cent."""
ENOUGH_POINTS = 80
"""Points of each image that are adjusted, about. Focal lengths then scatter by 0.05 and 0.26 % (the
sample, a plant in H.264), by 0.03 and 0.06 % with all 700."""


def focal_lengths_by_image(model: pycolmap.Reconstruction) -> dict[str, float]:
    """Focal length of each registered image, px, with a camera of its own; the model stays."""
    apart = pycolmap.Reconstruction()
    shared = next(iter(model.cameras.values()))
    ids = sorted(model.reg_image_ids())
    for image_id in ids:
        image = model.image(image_id)
        camera = pycolmap.Camera(
            model=shared.model_name,
            width=shared.width,
            height=shared.height,
            params=list(shared.params),
        )
        camera.camera_id = image_id
        apart.add_camera_with_trivial_rig(camera)
        pixels = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        copy = pycolmap.Image(
            name=image.name, camera_id=image_id, image_id=image_id, keypoints=pixels
        )
        apart.add_image_with_trivial_frame(copy, image.cam_from_world())
    for point in _enough_points(model):
        apart.add_point3D(point.xyz, point.track)
    adjust_once(apart, refine_focal=True, refine_lens=False, tolerance=TOLERANCE)
    return {apart.image(i).name: float(apart.cameras[i].mean_focal_length()) for i in ids}


def _enough_points(model: pycolmap.Reconstruction) -> list[pycolmap.Point3D]:
    """Points that give every image `ENOUGH_POINTS`, or all it has: those seen by most first."""
    seen: Counter[int] = Counter()
    chosen = []
    for point in sorted(model.points3D.values(), key=lambda each: -each.track.length()):
        images = [element.image_id for element in point.track.elements]
        if any(seen[image_id] < ENOUGH_POINTS for image_id in images):
            seen.update(images)
            chosen.append(point)
    return chosen


def group_zooms(focal_px: FloatArray) -> list[IntArray]:
    """The rows of each zoom among N focal lengths, the largest group first; all in one if unclear.

    Zooms are taken apart where both sides of a gap hold several images and are far narrower than
    it; single images that are off, and focal lengths that scatter, are no zooms.
    """
    logs = np.log(focal_px)
    order = np.argsort(logs)
    cuts = np.flatnonzero(np.diff(logs[order]) > np.log(APART)) + 1
    fewest = max(FEWEST_IMAGES, FEWEST_SHARE * len(logs))
    groups = [rows for rows in np.split(order, cuts) if len(rows) >= fewest]
    centres = [float(np.median(logs[rows])) for rows in groups]
    spreads = [float(np.std(logs[rows])) for rows in groups]
    for i in range(len(groups) - 1):
        if centres[i + 1] - centres[i] < TIGHT * max(spreads[i], spreads[i + 1]):
            return [np.arange(len(logs))]
    if len(groups) < 2:
        return [np.arange(len(logs))]
    return sorted((np.sort(rows) for rows in groups), key=len, reverse=True)


def describe_zooms(names: Sequence[str], focal_px: FloatArray, groups: Sequence[IntArray]) -> str:
    """The zooms, for people: how many images of each, the first of them, its focal length."""
    listed = "; ".join(
        f"{len(rows)} of {np.median(focal_px[rows]):.0f} px ({names[int(rows[0])]} ...)"
        for rows in groups
    )
    return f"the frames are of {len(groups)} zooms: {listed}"
