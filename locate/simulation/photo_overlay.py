"""`locate simulate SCENE.yaml --onto PHOTOS -o DIR`: simulated plumes before real photos."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.ndimage import map_coordinates, spline_filter

from geometry.arrays import FloatArray, FloatMap, GreyImage, IntArray
from geometry.camera import Camera
from geometry.threads import with_one_thread
from geometry.trajectory import Trajectory
from locate.simulation.image_formation import area_mean, digitise_grey
from locate.simulation.photo_set import PhotoSet
from locate.simulation.plume_field import PlumeField, visible_percentile
from locate.simulation.recording import Progress, ignore_progress
from locate.simulation.render import MASK_SHARE, NEGLIGIBLE_PX, RenderedTruth, apparent_shift
from locate.simulation.scene import ImageBlock, PlumeSpec, Scene
from locate.simulation.writer import PngFrameFolder, make_folder, write_summary, write_truth

LEAST_REDUCED = 2
"""Photo pixels per output pixel from which the resampling leaves no trace."""
COARSE_PX = 8
ENOUGH_POINTS = 20
SPLINE_REACH_PX = 24
"""How far the nearest pixels decide what a quintic spline is between them, to float32."""
BACKGROUND_FACTOR = 1.6
"""Range of the background over that of the plume, where a photo set has no points."""


def render_onto(
    scene: Scene,
    photos: Path,
    output: Path,
    *,
    reduce: int | None = None,
    progress: Progress = ignore_progress,
) -> None:
    """Renders the plumes of a scene onto a real posed photo set: `render_onto_set` of a folder.

    Args:
        scene: As of `render_onto_set`.
        photos: Folder with a COLMAP model, `.camera` files or transforms.json, and the photos.
        output: Folder to write.
        reduce: As of `render_onto_set`.
        progress: Called with the number of steps done and their total.

    Raises:
        BadInputError: The photo set cannot be used, or the folder cannot be written.
    """
    render_onto_set(scene, PhotoSet.load(photos), output, reduce=reduce, progress=progress)


def render_onto_set(
    scene: Scene,
    photo_set: PhotoSet,
    output: Path,
    *,
    reduce: int | None = None,
    progress: Progress = ignore_progress,
) -> None:
    """Renders the plumes of a scene onto photos with known poses.

    Reduced photos show no trace of the resampling: every pixel is resampled alike, displaced or
    not (a spline passes through its own pixels). The photo, of at least twice the output
    resolution, is blurred by the lens first, so that the quintic spline it is then read with
    passes all that is left of it, and the area mean follows. At full size there is nothing to
    spare: what stands still keeps its grain and coding, and what is displaced by parts of a pixel
    loses the finest of it. A network could learn that, so training clips are reduced; a
    measurement of displacement is not helped by it.
    Surfaces come from the sparse points, or are a plane behind the plume where there are none.

    Writes frames/{index:06d}.png, truth.json and truth/{index:06d}.npz into `output`.

    Args:
        scene: Its plumes, wind, seed, image formation and `video.fps` count; lengths are in the
            photos' unit, `source` in the photos' world. `camera.width` is about the output's,
            unless `reduce` says.
        photo_set: The photos.
        output: Folder to write.
        reduce: Photo pixels per output pixel along a side. 1 is the full size; None: what fits
            `scene.camera.width`, at least 2.
        progress: Called with the number of steps done and their total.

    Raises:
        BadInputError: A photo cannot be used, or the folder cannot be written.
    """
    outputs = {output: [plume.amplitude_px for plume in scene.plumes]}
    _render(scene, photo_set, outputs, reduce, progress)


def render_strengths_onto_set(
    scene: Scene, photo_set: PhotoSet, outputs: Mapping[float, Path], *, reduce: int | None = None
) -> None:
    """`render_onto_set` at several strengths, which costs little more than at one.

    Args:
        scene: As of `render_onto_set`; the strengths of its plumes do not count.
        photo_set: The photos.
        outputs: The folder to write for each strength: 95th percentile of |w| of every plume, px.
        reduce: As of `render_onto_set`.

    Raises:
        BadInputError: A photo cannot be used, or a folder cannot be written.
    """
    strengths = {folder: [px] * len(scene.plumes) for px, folder in outputs.items()}
    _render(scene, photo_set, strengths, reduce, ignore_progress)


@with_one_thread
def _render(
    scene: Scene,
    photo_set: PhotoSet,
    outputs: Mapping[Path, Sequence[float | None]],
    reduce: int | None,
    progress: Progress,
) -> None:
    """Writes each folder with plumes of its amplitudes, px; None: as strong as they physically are.

    The BLAS is held to one thread, as its threads cost more than the small matrices here do.
    """
    for output in outputs:
        make_folder(output)
    scene = _turn_scene(scene, photo_set)
    fitting = round(photo_set.trajectory.camera.width / scene.camera.width)
    factor = reduce or max(LEAST_REDUCED, fitting)
    trajectory = output_trajectory(photo_set.trajectory, factor, scene.video.fps)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    count = len(trajectory)
    steps = count * (1 + len(outputs))
    renderer = OverlayRenderer(
        trajectory, photo_set, fields, progress=lambda done, _: progress(done, steps)
    )
    for k, (output, amplitudes_px) in enumerate(outputs.items(), start=1):
        renderer.scale_to(amplitudes_px)
        folder = PngFrameFolder(output)
        for i in range(count):
            truth = renderer.frame_truth(i)
            photo = photo_set.read_image(i)
            image = displace_photo(
                photo, truth.displacement, factor, scene.image, scene.random_stream(4, i)
            )
            folder.write(image)
            write_truth(output, i, truth)
            progress(k * count + i + 1, steps)
        write_summary(output, trajectory, fields, renderer.amplitudes_px)


def displace_photo(
    photo: GreyImage,
    displacement: FloatMap,
    factor: int,
    image: ImageBlock,
    rng: np.random.Generator,
) -> GreyImage:
    """The photo reduced by `factor`, as the camera would take it through the plume.

    Args:
        photo: (>= H * factor, >= W * factor) grey values.
        displacement: (H, W, 2) px of the output.
        factor: Photo pixels per output pixel. At 1 the lens does not blur: it has done so already.
        image: Lens blur and noise.
        rng: Draws the noise.

    Returns:
        (H, W) grey values.
    """
    height, width = displacement.shape[0] * factor, displacement.shape[1] * factor
    fine = photo[:height, :width].astype(np.float32)
    if factor > 1:
        fine = cv2.GaussianBlur(fine, (0, 0), max(image.psf_sigma_px, 0.5) * factor)
    w = cv2.resize(displacement, (width, height), interpolation=cv2.INTER_LINEAR) * factor
    rows, columns = (np.flatnonzero(w.any(axis=(axis, 2))) for axis in (1, 0))
    if len(rows):
        part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        fine[part] = _read_displaced(fine, part, w[part])
    return digitise_grey(area_mean(fine, factor), image, rng)


def _read_displaced(picture: FloatMap, part: tuple[slice, slice], w: FloatMap) -> FloatMap:
    """The part of a picture, displaced by w; where w is 0 the spline passes through the pixels."""
    reach = SPLINE_REACH_PX + int(np.abs(w).max())
    window = tuple(slice(max(side.start - reach, 0), side.stop + reach) for side in part)
    coefficients = spline_filter(picture[window], order=5, output=np.float32, mode="mirror")
    y, x = np.mgrid[part].astype(np.float32)
    places = [y + w[..., 1] - window[0].start, x + w[..., 0] - window[1].start]
    read = map_coordinates(coefficients, places, order=5, mode="mirror", prefilter=False)
    return np.asarray(read, dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class _BentPixels:
    """The M pixels of a photo whose rays a plume bends.

    Attributes:
        pixels: (M,) their numbers, row by row.
        deflection: (M, 3) rad before the surface, of the plume as it physically is.
        turn_m: (M,) range of the bend.
        leg_m: (M,) from there to the surface.
    """

    pixels: IntArray
    deflection: FloatMap
    turn_m: FloatMap
    leg_m: FloatMap


class OverlayRenderer:
    """The displacement of plumes before a photo set.

    The rays are bent once, by the plumes as they physically are: a gain of the refractivity is one
    of the deflection.

    Args:
        trajectory: Of the frames.
        photo_set: Its sparse points give the surfaces.
        fields: The plumes, with a gain of 1.
        progress: Called with the number of frames bent and their total.

    Attributes:
        amplitudes_px: How strong each plume is.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        photo_set: PhotoSet,
        fields: Sequence[PlumeField],
        *,
        progress: Progress = ignore_progress,
    ) -> None:
        self._trajectory = trajectory
        self._points = photo_set.points_in_world
        self._fields = fields
        camera = trajectory.camera
        self._rays = camera.rays(camera.pixel_grid())
        self._depths: list[FloatMap] = []
        self._bent: list[list[_BentPixels]] = []
        sizes = np.zeros((len(trajectory), len(fields)))
        for i in range(len(trajectory)):
            self._depths.append(self._measured_depth(i))
            self._bent.append([self._bend_pixels(field, i) for field in fields])
            sizes[i] = [visible_percentile(self._displacement(i, k)) for k in range(len(fields))]
            progress(i + 1, len(trajectory))
        self._physical_px = [
            float(size[size > 0].mean()) if size.any() else 0.0 for size in sizes.T
        ]
        self.amplitudes_px: list[float] = []
        self.scale_to([field.plume.amplitude_px for field in fields])

    def scale_to(self, amplitudes_px: Sequence[float | None]) -> None:
        """Makes each plume so strong; None: as it physically is. Plumes out of sight stay so."""
        self.amplitudes_px = [
            field.scale_to(physical, wanted)
            for field, physical, wanted in zip(
                self._fields, self._physical_px, amplitudes_px, strict=True
            )
        ]

    def frame_truth(self, i: int) -> RenderedTruth:
        """What is true of photo `i`."""
        depth = self._depths[i]
        w = np.zeros((*depth.shape, 2), dtype=np.float32)
        for k in range(len(self._fields)):
            w += self._displacement(i, k)
        weakest = min(self.amplitudes_px, default=0.0)
        mask = np.linalg.norm(w, axis=-1) > max(MASK_SHARE * weakest, NEGLIGIBLE_PX)
        return RenderedTruth(displacement=w, mask=mask, depth=depth)

    def _displacement(self, i: int, k: int) -> FloatMap:
        """(H, W, 2) px of plume `k` in photo `i`."""
        bent = self._bent[i][k]
        w = np.zeros((self._rays[..., 0].size, 2), dtype=np.float32)
        w[bent.pixels] = apparent_shift(
            self._trajectory.camera,
            self._trajectory.rotations[i],
            self._directions(i)[bent.pixels],
            bent.deflection * np.float32(self._fields[k].gain),
            bent.turn_m,
            bent.leg_m,
        )
        return w.reshape(*self._rays.shape[:2], 2)

    def _directions(self, i: int) -> FloatMap:
        """(H * W, 3) unit rays of the pixels in the world."""
        turned = self._rays.reshape(-1, 3) @ self._trajectory.rotations[i]
        return np.asarray(turned, dtype=np.float32)

    def _bend_pixels(self, field: PlumeField, i: int) -> _BentPixels:
        ends = np.asarray(self._depths[i].ravel() / self._rays[..., 2].ravel(), dtype=np.float32)
        bend = field.bend_rays(i, self._trajectory.centers_in_world[i], self._directions(i))
        deflection = bend.deflection * bend.share_before(ends)[:, None]
        pixels = np.flatnonzero(np.abs(deflection).max(axis=1) > 0)
        return _BentPixels(
            pixels=pixels,
            deflection=deflection[pixels],
            turn_m=bend.range_m[pixels],
            leg_m=np.maximum(ends - bend.range_m, 0)[pixels],
        )

    def _measured_depth(self, i: int) -> FloatMap:
        camera = self._trajectory.camera
        in_cam = self._trajectory.world_to_cam(i, self._points)
        pixels = camera.project(in_cam)
        inside = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(axis=1)
        if inside.sum() < ENOUGH_POINTS:
            return np.full((camera.height, camera.width), self._plane_m(i), dtype=np.float32)
        return _densify_depth(pixels[inside], 1 / in_cam[inside, 2], camera)

    def _plane_m(self, i: int) -> float:
        sources = np.array([field.plume.source for field in self._fields]).reshape(-1, 3)
        depths = self._trajectory.world_to_cam(i, sources)[:, 2]
        return BACKGROUND_FACTOR * float(max(depths.max(initial=0.0), 1e-3))


def _densify_depth(pixels: FloatArray, inverse_depth: FloatArray, camera: Camera) -> FloatMap:
    """(H, W) depth from sparse points: inverse depth, linear between them, nearest outside."""
    y, x = np.mgrid[0 : camera.height : COARSE_PX, 0 : camera.width : COARSE_PX]
    linear = LinearNDInterpolator(pixels, inverse_depth)(x, y)
    nearest = NearestNDInterpolator(pixels, inverse_depth)(x, y)
    coarse = np.where(np.isfinite(linear), linear, nearest).astype(np.float32)
    coarse = cv2.GaussianBlur(cv2.medianBlur(coarse, 5), (0, 0), 1.0)
    size = (camera.width, camera.height)
    return np.asarray(1 / cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR))


def _turn_scene(scene: Scene, photo_set: PhotoSet) -> Scene:
    """The scene for the world with Z up, as long as the photo set."""

    def turned(plume: PlumeSpec) -> PlumeSpec:
        x, y, z = photo_set.target_from_photos(np.array(plume.source)).tolist()
        return plume.model_copy(update={"source": (x, y, z)})

    video = scene.video.model_copy(update={"frames": len(photo_set.paths)})
    plumes = tuple(turned(plume) for plume in scene.plumes)
    return scene.model_copy(update={"video": video, "plumes": plumes})


def output_trajectory(trajectory: Trajectory, factor: int, fps: float) -> Trajectory:
    """The poses of the photos reduced by `factor`, as frames of a video."""
    camera = trajectory.camera
    cropped = replace(
        camera,
        width=camera.width // factor * factor,
        height=camera.height // factor * factor,
    )
    return replace(trajectory, camera=cropped.scaled(1 / factor), times_s=trajectory.indices / fps)
