"""The column model of a plume: a slanted, widening column of air; the world's Z is up.

Thousands are scored at once, so many of them are rows of one array.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from geometry.arrays import BoolArray, FloatArray, IntArray

X, Y, Z, SLOPE_X, SLOPE_Y, HEIGHT, RADIUS, OPENING = range(8)
"""What each entry of a row is."""
LINE = [X, Y, SLOPE_X, SLOPE_Y]
"""The entries that say on which line the axis lies, at the height of the lowest point."""
GAP_SAMPLES = 9
"""Heights at which the distance of two axes is taken; chosen by hand."""


@dataclass(frozen=True, eq=False)
class PlumeColumn:
    """One column.

    Attributes:
        array: (8,) X, Y and Z of the lowest point of its axis, world units; how far X and Y move
            per unit of height; height along world Z and radius at the lowest point, world units;
            how much the radius grows per unit of height.
    """

    array: FloatArray

    @property
    def lowest_point(self) -> FloatArray:
        """(3,) where its axis begins."""
        return self.array[:3]

    @property
    def lowest_z(self) -> float:
        """World Z of the lowest point."""
        return self._entry(Z)

    @property
    def slope(self) -> FloatArray:
        """(2,) X and Y per unit of height."""
        return self.array[3:5]

    @property
    def height(self) -> float:
        """From the lowest to the highest point, along world Z."""
        return self._entry(HEIGHT)

    @property
    def radius(self) -> float:
        """At the lowest point, world units."""
        return self._entry(RADIUS)

    @property
    def opening(self) -> float:
        """Growth of the radius per unit of height."""
        return self._entry(OPENING)

    @property
    def line(self) -> FloatArray:
        """(4,) X and Y of the lowest point and the slopes."""
        return self.array[LINE]

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector along the rise of its axis."""
        rise = np.array([*self.slope, 1.0])
        return np.asarray(rise / np.linalg.norm(rise))

    @property
    def middle_xy(self) -> FloatArray:
        """(2,) X and Y of the axis at half the height."""
        return np.asarray(self.lowest_point[:2] + self.slope * self.height / 2)

    @property
    def as_columns(self) -> "Columns":
        """The one row that it is."""
        return Columns(self.array[None])

    def axis_points(self, heights: FloatArray) -> FloatArray:
        """(S, 3) points of the axis at (S,) heights above the lowest point."""
        points: FloatArray = self.as_columns.axis_points(heights[None])[0]
        return points

    def radii_at(self, heights: FloatArray) -> FloatArray:
        """(S,) radii at (S,) heights; below the lowest point the radius it has there."""
        return np.asarray(self.radius + self.opening * np.clip(heights, 0, None))

    def cut_slabs(self, heights: FloatArray, thickness: float) -> "Columns":
        """S columns cut from it, each `thickness` high, centred on the (S,) heights.

        Heights below the lowest point continue its axis with the radius it has there.
        """
        cut = np.repeat(self.array[None], len(heights), axis=0)
        low = heights - thickness / 2
        cut[:, [X, Y, Z]] = self.axis_points(low)
        cut[:, HEIGHT] = thickness
        cut[:, RADIUS] = self.radii_at(low)
        return Columns(cut)

    def on_line(self, line: FloatArray) -> Self:
        """The same with its axis on another line; see `line`."""
        array = self.array.copy()
        array[LINE] = line
        return type(self)(array)

    def moved_to(self, lowest_point: FloatArray) -> Self:
        """The same with another (3,) lowest point."""
        array = self.array.copy()
        array[[X, Y, Z]] = lowest_point
        return type(self)(array)

    def shifted(self, shift_xy: FloatArray) -> Self:
        """The same, (2,) world units aside."""
        shift = np.zeros(8)
        shift[[X, Y]] = shift_xy
        return type(self)(self.array + shift)

    def widened(self, factor: float) -> Self:
        """The same, `factor` as wide at every height."""
        array = self.array.copy()
        array[[RADIUS, OPENING]] *= factor
        return type(self)(array)

    def with_even_radius(self, radius: float) -> Self:
        """The same with this radius at every height."""
        return type(self)(self.as_columns.with_even_radius(radius).array[0])

    def midway_to(self, other: "PlumeColumn") -> Self:
        """The mean of the two."""
        return type(self)((self.array + other.array) / 2)

    def gap_to(self, other: "PlumeColumn") -> float:
        """Smallest horizontal distance of two axes over the heights both span, or nearly span."""
        low = max(self.lowest_z, other.lowest_z)
        high = min(self.lowest_z + self.height, other.lowest_z + other.height)
        z = np.linspace(min(low, high), max(low, high), GAP_SAMPLES)[:, None]
        own = self.lowest_point[:2] + self.slope * (z - self.lowest_z)
        others = other.lowest_point[:2] + other.slope * (z - other.lowest_z)
        return float(np.linalg.norm(own - others, axis=1).min())

    def widest_gap_to(self, other: "PlumeColumn") -> float:
        """Largest horizontal distance of another axis, over the heights of this one."""
        ends = self.axis_points(np.array([0.0, self.height]))
        there = other.axis_points(ends[:, 2] - other.lowest_z)
        return float(np.linalg.norm(ends - there, axis=1).max())

    def _entry(self, index: int) -> float:
        entry: float = self.array[index]
        return entry


@dataclass(frozen=True, eq=False)
class Columns:
    """N columns.

    Attributes:
        array: (N, 8) one `PlumeColumn` per row.
    """

    array: FloatArray

    @classmethod
    def of(cls, columns: Sequence[PlumeColumn]) -> Self:
        """These, in one array."""
        return cls(np.reshape([column.array for column in columns], (-1, 8)))

    def __len__(self) -> int:
        return len(self.array)

    def __iter__(self) -> Iterator[PlumeColumn]:
        return map(PlumeColumn, self.array)

    def __getitem__(self, index: int | np.integer) -> PlumeColumn:
        return PlumeColumn(self.array[index])

    @property
    def lowest_points(self) -> FloatArray:
        """(N, 3) where their axes begin."""
        return self.array[:, :3]

    @property
    def slopes(self) -> FloatArray:
        """(N, 2) X and Y per unit of height."""
        return self.array[:, 3:5]

    @property
    def heights(self) -> FloatArray:
        """(N,) from the lowest to the highest points, along world Z."""
        return self.array[:, HEIGHT]

    @property
    def radii(self) -> FloatArray:
        """(N,) at the lowest points, world units."""
        return self.array[:, RADIUS]

    @property
    def openings(self) -> FloatArray:
        """(N,) growth of the radius per unit of height."""
        return self.array[:, OPENING]

    def take(self, rows: IntArray | BoolArray | slice) -> Self:
        """Some of them."""
        return type(self)(self.array[rows])

    def followed_by(self, others: "Columns") -> Self:
        """These and then the others."""
        return type(self)(np.concatenate([self.array, others.array]))

    def axis_points(self, heights: FloatArray) -> FloatArray:
        """(N, S, 3) points of the axes at (N, S) heights above the lowest points."""
        x, y, z = self.lowest_points.T[:, :, None]
        slope_x, slope_y = self.slopes.T[:, :, None]
        return np.stack([x + slope_x * heights, y + slope_y * heights, z + heights], axis=-1)

    def with_even_radius(self, radius: float) -> Self:
        """The same, all with this radius at every height."""
        array = self.array.copy()
        array[:, [RADIUS, OPENING]] = radius, 0.0
        return type(self)(array)
