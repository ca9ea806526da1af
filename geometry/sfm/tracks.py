"""Features of an ordered recording followed from frame to frame, to a tenth of a pixel.

A feature moves with the image by pyramidal Lucas-Kanade, forth and back, and must keep to the
epipolar geometry of the two frames. Its place is then measured again in a small window against the
frame it comes from, so that errors of the steps do not add up.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
import pycolmap

from geometry.arrays import BoolArray, FloatArray, GreyImage, IntArray
from geometry.errors import LocateError

MAX_TRACKS = 700
"""Most features followed at a time; weaker ones add bias, not accuracy."""
SPACING_SHARE = 1.0 / 42
"""Least distance between new features and others, over the longest side: wide enough that weak
texture gets its share."""
CORNER_QUALITY = 0.003
"""Least strength of a corner, over that of the strongest."""
RENEWED_BELOW = 0.95
"""Share of `MAX_TRACKS` below which new features are looked for."""
STEP_WINDOW, LEVELS = 11, 3
"""Window, px, and coarser pyramid levels of a step between frames."""
PLACE_WINDOW = 5
"""Window, px, of the place: a smaller one is less bent by slants and by depth within it."""
TEMPLATE_FRAMES = 25
"""Frames after which a place is measured against a newer one."""
MAX_RETURN_PX = 0.5
"""Largest distance between a feature and itself after a step forth and back."""
MAX_CORRECTION_PX = 0.7
"""Largest distance between a step's end and the place; beyond it the feature has changed."""
EPIPOLAR_PX = 1.0
"""Largest distance from the epipolar line of two neighbouring frames."""
MARGIN_PX = 3
"""A feature this near to the edge of the image is lost."""
MIN_SHARED = 100
"""Fewest features that two frames in a row share where tracks are unbroken."""
MIN_LASTING = 250
"""Fewest features that three frames in a row typically share: two alone do not hand on a scale.
Photos taken apart (fountain-P11) share 90, a video of a runner 200, others 370 and more."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)


class BrokenTracksError(LocateError):
    """Tracks do not tie the frames together; the text says where or why."""


@dataclass(frozen=True, kw_only=True)
class TrackedFrame:
    """The features of one frame.

    Attributes:
        ids: (M,) ascending; the same feature has the same id in every frame.
        pixels: (M, 2) where they are, px, (0, 0) at the centre of the top-left pixel.
    """

    ids: IntArray
    pixels: FloatArray


def follow_features(images: Iterable[GreyImage]) -> list[TrackedFrame]:
    """Follows features through frames in their order.

    Args:
        images: Read one after the other; few of them are held at a time.

    Returns:
        The features of each frame.

    Raises:
        BrokenTracksError: At the first two frames that share fewer than `MIN_SHARED` features or
            differ in size; in the end, where frames are so far apart that few features last.
    """
    tracker = _Tracker()
    frames: list[TrackedFrame] = []
    for row, image in enumerate(images):
        if frames and image.shape != tracker.images[row - 1].shape:
            raise BrokenTracksError(f"key frames {row - 1} and {row} differ in size")
        frame = tracker.add_frame(image)
        frames.append(frame)
        if row and (shared := _count_shared(frames, row - 1, row)) < MIN_SHARED:
            raise BrokenTracksError(
                f"key frames {row - 1} and {row} share {shared} features (needs {MIN_SHARED})"
            )
    lasting = np.median([_count_shared(frames, row - 2, row) for row in range(2, len(frames))])
    if lasting < MIN_LASTING:
        raise BrokenTracksError(
            f"three key frames share {lasting:.0f} features (needs {MIN_LASTING})"
        )
    return frames


def _count_shared(frames: list[TrackedFrame], first: int, second: int) -> int:
    return len(np.intersect1d(frames[first].ids, frames[second].ids, assume_unique=True))


@dataclass(kw_only=True)
class _Tracker:
    """Features of the latest frame.

    Attributes:
        ids: (M,) ascending.
        pixels: (M, 2) float32.
        origins: (M,) the frame each is measured against.
        origin_pixels: (M, 2) its place there.
        images: The latest frames, by number.
    """

    ids: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    pixels: FloatArray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    origins: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    origin_pixels: FloatArray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    images: dict[int, GreyImage] = field(default_factory=dict)
    count: int = 0
    next_id: int = 0

    def add_frame(self, image: GreyImage) -> TrackedFrame:
        """Follows the features into the next frame and finds new ones there."""
        self.images[self.count] = image
        self.images.pop(self.count - TEMPLATE_FRAMES - 1, None)
        if len(self.ids):
            self._follow()
        self._find_new()
        self.count += 1
        return TrackedFrame(ids=self.ids, pixels=self.pixels.astype(float))

    def _follow(self) -> None:
        before, now = self.images[self.count - 1], self.images[self.count]
        moved, kept = _step(before, now, self.pixels)
        for origin in np.unique(self.origins[kept]):
            rows = np.flatnonzero(kept & (self.origins == origin))
            moved[rows], kept[rows] = _place(
                self.images[int(origin)], now, self.origin_pixels[rows], moved[rows]
            )
        rows = np.flatnonzero(kept)
        kept[rows] = _fit_epipolar_geometry(self.pixels[rows], moved[rows])
        self.ids, self.pixels = self.ids[kept], moved[kept]
        self.origins, self.origin_pixels = self.origins[kept], self.origin_pixels[kept]
        old = self.origins <= self.count - TEMPLATE_FRAMES
        self.origins[old], self.origin_pixels[old] = self.count, self.pixels[old]

    def _find_new(self) -> None:
        wanted = MAX_TRACKS - len(self.ids)
        if len(self.ids) > RENEWED_BELOW * MAX_TRACKS:
            return
        image = self.images[self.count]
        spacing = max(image.shape) * SPACING_SHARE
        free = np.full(image.shape, 255, np.uint8)
        for x, y in np.rint(self.pixels).astype(int).tolist():
            cv2.circle(free, (x, y), round(spacing), 0, -1)
        corners = cv2.goodFeaturesToTrack(
            image, wanted, CORNER_QUALITY, spacing, mask=free, blockSize=5
        )
        if corners is None:
            return
        found = corners.reshape(-1, 2)
        self.ids = np.concatenate([self.ids, self.next_id + np.arange(len(found))])
        self.next_id += len(found)
        self.pixels = np.concatenate([self.pixels, found])
        self.origins = np.concatenate([self.origins, np.full(len(found), self.count)])
        self.origin_pixels = np.concatenate([self.origin_pixels, found])


def _step(before: GreyImage, now: GreyImage, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(M, 2) where features went, and which came back when followed the other way."""
    size = (STEP_WINDOW, STEP_WINDOW)
    moved, forth, _ = cv2.calcOpticalFlowPyrLK(
        before, now, pixels, None, winSize=size, maxLevel=LEVELS, criteria=_STOP
    )
    back, home, _ = cv2.calcOpticalFlowPyrLK(
        now,
        before,
        moved,
        pixels.copy(),
        winSize=size,
        maxLevel=LEVELS,
        criteria=_STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    height, width = now.shape
    inside = (moved >= MARGIN_PX) & (moved <= np.array([width, height]) - 1 - MARGIN_PX)
    returned = np.linalg.norm(back - pixels, axis=1) < MAX_RETURN_PX
    seen = (forth.ravel() > 0) & (home.ravel() > 0)
    return moved, seen & returned & inside.all(axis=1)


def _place(
    origin: GreyImage, now: GreyImage, origin_pixels: FloatArray, pixels: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """(M, 2) where features of an earlier frame are, starting near by, and which were found."""
    placed, found, _ = cv2.calcOpticalFlowPyrLK(
        origin,
        now,
        origin_pixels,
        pixels.copy(),
        winSize=(PLACE_WINDOW, PLACE_WINDOW),
        maxLevel=0,
        criteria=_STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    near = np.linalg.norm(placed - pixels, axis=1) < MAX_CORRECTION_PX
    return placed, (found.ravel() > 0) & near


def _fit_epipolar_geometry(before: FloatArray, now: FloatArray) -> BoolArray:
    """Which of the matches one epipolar geometry explains; none where nothing does."""
    options = pycolmap.RANSACOptions()
    options.max_error = EPIPOLAR_PX
    options.random_seed = 0
    options.max_num_trials = 500
    options.min_num_trials = 20
    options.confidence = 0.999
    fit = pycolmap.estimate_fundamental_matrix(before.astype(float), now.astype(float), options)
    return np.zeros(len(now), dtype=bool) if fit is None else np.asarray(fit["inlier_mask"])
