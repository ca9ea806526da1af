"""What the user knows of sizes in the scene: a printed board, the distance of two points."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.georeference import ScaleConstraint
from geometry.georeference.board import find_board, marker_board, scale_from_board
from geometry.georeference.lengths import point_from_pixels, scale_from_distance
from geometry.json_values import check_fields
from geometry.text_files import read_json
from geometry.trajectory import Trajectory
from locate.recording.images import FrameImages

_BOARD = re.compile(r"(\w+):([\d.]+)(?::(\d+)x(\d+)(?::([\d.]+))?)?")
BOARD_SYNTAX = "DICTIONARY:SIZE[:COLUMNSxROWS[:GAP]] in m, as in 4X4_50:0.15"
Pixel = tuple[FiniteFloat, FiniteFloat]
Clicks = Annotated[dict[str, Pixel], Field(min_length=2)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class KnownDistance(BaseModel):
    """The distance of two points, each clicked in at least two frames.

    Attributes:
        distance_m: Between the points.
        sigma_m: Of the distance.
        sigma_px: Of a click, along each axis.
        points: By the name of each of the two: pixel (x, y) by the file name of the frame in the
            run's ``frames/``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    distance_m: Positive
    sigma_m: Positive = 0.01
    sigma_px: Positive = 1.0
    points: Annotated[dict[str, Clicks], Field(min_length=2, max_length=2)]

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a JSON file.

        Raises:
            BadInputError: It cannot be read, or a field is wrong; named.
        """
        content = read_json(path)
        try:
            return check_fields(cls, content)
        except ValueError as error:
            raise BadInputError(f"{path}: {error}") from error

    def constrain_scale(self, trajectory: Trajectory, rows: Mapping[str, int]) -> ScaleConstraint:
        """The scale of a reconstruction by this distance.

        Args:
            trajectory: The cameras.
            rows: Of each registered frame in the trajectory, by its name.

        Raises:
            BadInputError: A point was not clicked in two registered frames from two places, a
                click is outside its frame, or the clicks are on no common point.
        """
        self._check_bounds(trajectory.camera)
        found = [self._point(name, trajectory, rows) for name in self.points]
        (first, first_covariance), (second, second_covariance) = found
        return scale_from_distance(
            first,
            second,
            self.distance_m,
            sigma_m=self.sigma_m,
            covariances=(first_covariance, second_covariance),
            name=" to ".join(self.points),
        )

    def unused_clicks(self, used: Collection[str]) -> list[str]:
        """The clicks in other frames than those, each by its point and frame."""
        return [
            f"{name} in {frame}"
            for name, clicks in self.points.items()
            for frame in clicks
            if frame not in used
        ]

    def _check_bounds(self, camera: Camera) -> None:
        for name, clicks in self.points.items():
            for frame, (x, y) in clicks.items():
                inside = abs(x - (camera.width - 1) / 2) <= camera.width / 2
                if not inside or abs(y - (camera.height - 1) / 2) > camera.height / 2:
                    raise BadInputError(
                        f"known distance: {name}: the click at ({x:g}, {y:g}) px is outside "
                        f"{frame}, which is {camera.width}x{camera.height} px; click in the "
                        "images of the run's frames/"
                    )

    def _point(
        self, name: str, trajectory: Trajectory, rows: Mapping[str, int]
    ) -> tuple[FloatArray, FloatArray]:
        clicks = {frame: pixel for frame, pixel in self.points[name].items() if frame in rows}
        try:
            return point_from_pixels(
                trajectory,
                np.array([rows[frame] for frame in clicks], dtype=np.int64),
                np.array(list(clicks.values()), dtype=float).reshape(-1, 2),
                sigma_px=self.sigma_px,
                names=list(clicks),
            )
        except BadInputError as error:
            strange = ", ".join(sorted(self.points[name].keys() - rows.keys()))
            hint = f" (not a registered frame: {strange})" if strange else ""
            raise BadInputError(f"known distance: {name}: {error}{hint}") from error


@dataclass(frozen=True, kw_only=True)
class KnownLengths:
    """What is known of sizes, checked before anything is done.

    Attributes:
        board: A board of ``cv2.aruco``, or None.
        distance: Of two points, or None.
    """

    board: Any = None
    distance: KnownDistance | None = None

    @classmethod
    def of(cls, board: str | None, distance: Path | None) -> Self:
        """Reads the options.

        Args:
            board: In the form of `BOARD_SYNTAX`.
            distance: A JSON file, see `KnownDistance`.

        Raises:
            BadInputError: One of them is wrong.
        """
        return cls(
            board=None if board is None else parse_board(board),
            distance=None if distance is None else KnownDistance.load(distance),
        )

    def constrain_scale(
        self, trajectory: Trajectory, folder: Path, names: Sequence[str]
    ) -> list[ScaleConstraint]:
        """The scale of a reconstruction by each of the lengths.

        Args:
            trajectory: N cameras.
            folder: Where their images are.
            names: N file names.

        Raises:
            BadInputError: The board is not found, or a point cannot be.
        """
        scales = []
        if self.board is not None:
            sightings = find_board(FrameImages([folder / name for name in names]), self.board)
            scales.append(scale_from_board(trajectory, sightings))
        if self.distance is not None:
            rows = {name: row for row, name in enumerate(names)}
            self._check_frames(self.distance, folder)
            scales.append(self.distance.constrain_scale(trajectory, rows))
        return scales

    def describe_unused(self, names: Collection[str]) -> tuple[str, ...]:
        """The note on clicks in frames that were not registered, where there are any."""
        unused = [] if self.distance is None else self.distance.unused_clicks(names)
        if not unused:
            return ()
        return (f"Known distance: clicks in frames without a pose left out: {', '.join(unused)}.",)

    @staticmethod
    def _check_frames(distance: KnownDistance, folder: Path) -> None:
        frames = {path.name for path in folder.iterdir()}
        strange = distance.unused_clicks(frames)
        if strange:
            raise BadInputError(
                f"known distance: {strange[0]}: no such image among the run's frames"
            )


def parse_board(text: str) -> Any:
    """The board that a user names.

    Raises:
        BadInputError: The text is not of the syntax, or names no board.
    """
    found = _BOARD.fullmatch(text)
    try:
        if found is None:
            raise ValueError("no match")
        dictionary, size, columns, rows, gap = found.groups()
        sizes = {"size_m": float(size), "gap_m": float(gap or 0)}
    except ValueError as error:
        raise BadInputError(f"board {text!r}: expected {BOARD_SYNTAX}") from error
    return marker_board(dictionary, columns=int(columns or 1), rows=int(rows or 1), **sizes)
