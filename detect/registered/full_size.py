"""The information of frames at their full size, where flow was measured at a smaller one.

Depth, poses and flow are smooth and gain little from more pixels; the information of a displacement
grows with them. So flow is enlarged and only that is measured at full size, some rows at a time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from detect.information import MAP_WIDTH_PX, DisplacementInformation
from detect.registered.information import (
    RegisteredFrames,
    halve,
    is_blurred,
    measure_pixels,
    sum_pixels,
)
from detect.warp import pixel_grid, sample
from geometry.arrays import FloatArray, FloatMap

STRIP_PIXELS = 1 << 20
"""Pixels that are measured together: they bound the memory that is needed."""
REACH_PX = 24
"""Rows beyond its own that a strip is measured with: the filters reach that far."""
SAMPLE_REACH_PX = 4
"""Rows beyond those read that reading between pixels needs."""
BORDER_PX = 2
"""Width of the edge of an image in which nothing counts as seen."""
MOST_HALVINGS = 2
"""How often frames are halved at most; chosen by hand."""
SAMPLED_STRIPS, SAMPLED_ROWS = 8, 48
"""Strips spread over the frame, and their rows, that show whether it is blurred; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class FullSizeFrames:
    """A key frame and N neighbours at full size, and how they move at a smaller one.

    Attributes:
        images: The key frame, then the neighbours, (H, W) grey levels each.
        flows: (N, 2, h, w) from the key frame into each neighbour, px of the smaller size.
        slopes: (N, 2, h, w) px of the smaller size per unit of inverse depth.
        depth_edge_px: (h, w) by how much parallax varies round a pixel, px of the smaller size.
    """

    images: Sequence[FloatMap]
    flows: FloatMap
    slopes: FloatMap
    depth_edge_px: FloatMap

    def measure(self) -> DisplacementInformation:
        """The information of the key frame, displacements in px of the smaller size.

        Frames that hold no detail at their size are measured at half of it, and so on. They are
        registered at full size all the same: reading between pixels is best there.
        """
        halvings = self.count_halvings()
        shape = (self._height >> halvings, self._width >> halvings)
        vector, matrix = np.empty((*shape, 2), np.float32), np.empty((*shape, 3), np.float32)
        for rows, wider in self._strips(REACH_PX << halvings):
            frames = self._register(wider)
            for _ in range(halvings):
                frames = frames.halved()
            strip = measure_pixels(frames)
            first, start, stop = (row >> halvings for row in (wider.start, rows.start, rows.stop))
            inside = slice(start - first, stop - first)
            vector[start:stop], matrix[start:stop] = strip.vector[inside], strip.matrix[inside]
        pixels = DisplacementInformation(vector=vector, matrix=matrix)
        return sum_pixels(pixels).in_units_of((1 << halvings) / float(self._factors.mean()))

    def count_halvings(self) -> int:
        """How often the frames can be halved without a loss of detail."""
        means = [self._register(rows).mean for rows in self._sampled_strips()]
        for halvings in range(MOST_HALVINGS):
            if self._width >> halvings < 2 * MAP_WIDTH_PX or not is_blurred(means):
                return halvings
            means = [halve(mean) for mean in means]
        return MOST_HALVINGS

    @property
    def _height(self) -> int:
        return len(self.images[0])

    @property
    def _width(self) -> int:
        return int(self.images[0].shape[1])

    @property
    def _factors(self) -> FloatArray:
        """(2,) full over smaller width, and height."""
        return np.divide(self.images[0].shape[::-1], self.depth_edge_px.shape[::-1])

    def _sampled_strips(self) -> list[slice]:
        if self._height <= SAMPLED_STRIPS * SAMPLED_ROWS:
            return [slice(0, self._height)]
        starts = np.linspace(0, self._height - SAMPLED_ROWS, SAMPLED_STRIPS).astype(int).tolist()
        return [slice(start, start + SAMPLED_ROWS) for start in starts]

    def _strips(self, reach: int) -> Iterator[tuple[slice, slice]]:
        """Rows some at a time, and these with `reach` rows on both sides, where there are any.

        Each strip begins where pixels of halved frames do.
        """
        block = 1 << MOST_HALVINGS
        step = max(2 * REACH_PX, STRIP_PIXELS // self._width // block * block)
        for start in range(0, self._height, step):
            stop = min(start + step, self._height)
            wider = slice(max(0, start - reach), min(self._height, stop + reach))
            yield slice(start, stop), wider

    def _register(self, rows: slice) -> RegisteredFrames:
        key, *neighbours = self.images
        shape = (rows.stop - rows.start, self._width)
        factors = self._factors.astype(np.float32)
        grid = pixel_grid(shape)
        grid[..., 1] += rows.start
        x, y = grid[0, :, 0], grid[:, 0, 1]
        registered, visible = np.empty((2, len(neighbours), *shape), np.float32)
        slopes = np.empty((len(neighbours), 2, *shape), np.float32)
        for k, neighbour in enumerate(neighbours):
            moved = cv2.merge([self._enlarge(part, rows) for part in self.flows[k]])
            moved *= factors
            visible[k] = visible_mask(np.moveaxis(moved, -1, 0), x, y, neighbour.shape)
            moved += grid
            registered[k] = _sample_some(neighbour, moved)
            for part, slope, factor in zip(slopes[k], self.slopes[k], factors, strict=True):
                np.multiply(self._enlarge(slope, rows), factor, out=part)
        edges = self._enlarge(self.depth_edge_px, rows) * factors.mean()
        return RegisteredFrames(
            key=key[rows],
            neighbours=registered,
            slopes=slopes,
            visible=visible,
            depth_edge_px=edges,
        )

    def _enlarge(self, plane: FloatMap, rows: slice) -> FloatMap:
        """Some rows of a plane of the smaller size at full size; pixel centres stay in place."""
        along_x, along_y = 1 / self._factors
        first_row = (rows.start + 0.5) * along_y - 0.5
        move = np.array([[along_x, 0, 0.5 * along_x - 0.5], [0, along_y, first_row]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = (self._width, rows.stop - rows.start)
        enlarged = cv2.warpAffine(plane, move, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(enlarged)


def _sample_some(image: FloatMap, positions: FloatMap) -> FloatMap:
    """`detect.warp.sample`, for positions in a few rows of a large image."""
    lowest, highest = positions[..., 1].min(), positions[..., 1].max()
    first, last = np.clip([lowest - SAMPLE_REACH_PX, highest + SAMPLE_REACH_PX], 0, len(image) - 1)
    top = int(first)
    moved = positions - np.array([0, top], np.float32)
    return sample(image[top : int(last) + 2], moved)


def visible_mask(flow: FloatMap, x: FloatMap, y: FloatMap, shape: tuple[int, ...]) -> FloatMap:
    """(..., H, W) 1 where pixels are still in an image when they have moved, else 0.

    Args:
        flow: (..., 2, H, W) by how much they move, px.
        x: (W,) where they are, px.
        y: (H,) likewise.
        shape: Of the image.
    """
    low_x, low_y = BORDER_PX - x, BORDER_PX - y[:, None]
    height, width = (side - 1 - 2 * BORDER_PX for side in shape)
    along_x, along_y = np.moveaxis(flow, -3, 0)
    inside = (along_x >= low_x) & (along_x <= low_x + width)
    inside &= (along_y >= low_y) & (along_y <= low_y + height)
    return np.asarray(inside, dtype=np.float32)
