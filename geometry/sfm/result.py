"""What structure from motion hands on, and its files."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.errors import BadInputError
from geometry.npz import check_numbers, read_npz, save_arrays
from geometry.text_files import read_json
from geometry.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Reconstruction:
    """Registered frames and the sparse points they see, in a normalised scene frame.

    Attributes:
        trajectory: The F registered frames; `indices` are theirs among the frames given.
        names: F image names, in the order of the trajectory.
        points_in_world: (M, 3) sparse points, scene units.
        point_errors_px: (M,) mean reprojection error of each point.
        visible: F arrays of rows of `points_in_world`, the points each frame sees.
        report: Plain numbers and strings for people; None where a number is not known.
    """

    trajectory: Trajectory
    names: tuple[str, ...]
    points_in_world: FloatArray
    point_errors_px: FloatArray
    visible: tuple[IntArray, ...]
    report: dict[str, Any]

    def save(self, folder: Path) -> None:
        """Writes trajectory.json, points.npz and report.json."""
        folder.mkdir(parents=True, exist_ok=True)
        self.trajectory.save(folder / "trajectory.json")
        save_arrays(
            folder / "points.npz",
            points_in_world=self.points_in_world,
            point_errors_px=self.point_errors_px,
            visible=np.concatenate([np.zeros(0, dtype=np.int64), *self.visible]),
            visible_counts=np.array([len(rows) for rows in self.visible], dtype=np.int64),
        )
        report = {"names": list(self.names), "report": self.report}
        (folder / "report.json").write_text(json.dumps(report, indent=1, allow_nan=False))

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: A file is missing or damaged.
        """
        trajectory = Trajectory.load(folder / "trajectory.json")
        points = read_npz(folder / "points.npz")
        try:
            content = read_json(folder / "report.json")
            _check_points(**points)
            ends = np.cumsum(points["visible_counts"])[:-1]
            return cls(
                trajectory=trajectory,
                names=tuple(content["names"]),
                points_in_world=points["points_in_world"],
                point_errors_px=points["point_errors_px"],
                visible=tuple(np.split(points["visible"], ends)),
                report=content["report"],
            )
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BadInputError(f"{folder}: not a readable reconstruction ({error})") from error


def _check_points(
    points_in_world: FloatArray,
    point_errors_px: FloatArray,
    visible: IntArray,
    visible_counts: IntArray,
) -> None:
    check_numbers(points_in_world=points_in_world, point_errors_px=point_errors_px)
    count = len(point_errors_px)
    if points_in_world.shape != (count, 3) or point_errors_px.ndim != 1:
        raise ValueError("its points have other shapes")
    for rows in (visible, visible_counts):
        if rows.ndim != 1 or rows.dtype.kind not in "iu":
            raise ValueError("the points that a frame sees are not given by their rows")
    if len(visible) and (visible.min() < 0 or visible.max() >= count):
        raise ValueError("a frame sees points that are not in the file")
