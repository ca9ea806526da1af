"""A plume's potential, put into the frame of a camera."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.ndimage import map_coordinates

from detect.synthesis.flows import potential_gradient
from geometry.arrays import FloatArray, FloatMap


@dataclass(frozen=True, kw_only=True)
class PlumePlacement:
    """Where, how large and which way round a potential is in a frame.

    The potential is turned, not the vectors: the gradient of what was turned is turned properly.

    Attributes:
        frame_from_cells: (2, 2) px per cell: scale, rotation and flip.
        center_px: (2,) where the middle of the potential is, x right, y down.
    """

    frame_from_cells: FloatArray
    center_px: FloatArray

    @classmethod
    def draw_uniform(
        cls,
        rng: np.random.Generator,
        potential: FloatMap,
        *,
        size_px: int,
        relative_length: float,
        visible: float,
    ) -> Self:
        """Uniform over all positions that bring something visible into the frame.

        As no position is preferred, every pixel of the frame is equally likely to be covered.

        Args:
            rng: Draws angle, flip and position.
            potential: (h, w) normalised.
            size_px: Side of the frame.
            relative_length: Longest side of the potential, in sides of the frame.
            visible: Slope, of the peak 1, that counts as seen.
        """
        zoom = relative_length * size_px / max(potential.shape)
        turn = rng.uniform(0, 2 * np.pi)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        frame_from_cells = zoom * rotation @ np.diag([rng.choice([-1.0, 1.0]), 1.0])
        seen = np.argwhere(np.linalg.norm(potential_gradient(potential), axis=-1) > visible)[
            :, ::-1
        ]
        offsets = (seen - _image_middle(potential)) @ frame_from_cells.T
        while True:
            center = rng.uniform(-offsets.max(axis=0), size_px - 1 - offsets.min(axis=0))
            inside = (offsets + center >= 0) & (offsets + center <= size_px - 1)
            if inside.all(axis=1).any():
                return cls(frame_from_cells=frame_from_cells, center_px=center)

    def displacement(
        self, potential: FloatMap, *, size_px: int, margin_px: int, drift_px: FloatArray
    ) -> FloatMap:
        """The gradient of the placed potential: peak 1, without curl.

        Args:
            potential: (h, w) normalised.
            size_px: Side of the frame.
            margin_px: How far beyond the frame.
            drift_px: (2,) how far the plume has moved on.

        Returns:
            (size + 2 margin, size + 2 margin, 2), x right, y down.
        """
        axis = np.arange(-margin_px - 1.0, size_px + margin_px + 1)
        cells_from_frame = np.linalg.inv(self.frame_from_cells)
        offset = _image_middle(potential) - cells_from_frame @ (self.center_px + drift_px)
        cells = [row[0] * axis + row[1] * axis[:, None] + o
                 for row, o in zip(cells_from_frame, offset, strict=True)]  # fmt: skip
        zoom = np.sqrt(abs(np.linalg.det(self.frame_from_cells)))
        placed = map_coordinates(potential, cells[::-1], output=np.float32) * np.float32(zoom)
        return potential_gradient(placed)[1:-1, 1:-1]


def _image_middle(potential: FloatMap) -> FloatArray:
    """(2,) the middle of an image in its own cells, (x, y)."""
    return (np.array(potential.shape[::-1]) - 1) / 2
