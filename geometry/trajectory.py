"""Where the camera was: poses with covariances, and what is known of the world they live in."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray, IntArray
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.json_values import as_numbers, as_truth, as_whole_number
from geometry.quaternions import rotation_of
from geometry.similarity import Similarity
from geometry.text_files import read_json

SCHEMA = "locate.trajectory/1"
READABLE_SCHEMAS = (SCHEMA, "locate.truth/1")
"""The truth of a simulation carries the same block."""
FARTHEST = 1e9
"""World units from the origin. Coordinates on the Earth stay below 1e7 m; images are measured in
32-bit numbers, in which the squares of 1e19 are infinite."""
CLOSEST = 1e-6
"""World units that the cameras of a path lie apart: a micrometre, where the unit is the metre. Much
smaller ones vanish beside any tolerance."""
MOST_VARIANCE = FARTHEST**2
"""Largest element of a covariance, squared units."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Camera poses of N frames, in one world frame.

    Attributes:
        camera: The camera that took every frame.
        indices: (N,) index of each frame in the source video or folder, ascending.
        times_s: (N,) time of each frame in s.
        rotations: (N, 3, 3) cam_from_world.
        translations: (N, 3) cam_from_world, in world units.
        covariances: (N, 6, 6) of world_from_cam in gtsam's order [rotation (rad), translation],
            right tangent; NaN rows where unknown. None where nothing is known of any frame.
        metric: The world unit is the metre; otherwise it is a free "scene unit".
        gravity: World Z is known to point up; otherwise the direction of up is a guess.
    """

    camera: Camera
    indices: IntArray
    times_s: FloatArray
    rotations: FloatArray
    translations: FloatArray
    covariances: FloatArray | None = None
    metric: bool = False
    gravity: bool = False

    def __post_init__(self) -> None:
        n = len(self.indices)
        shapes = {
            "times_s": (self.times_s.shape, (n,)),
            "rotations": (self.rotations.shape, (n, 3, 3)),
            "translations": (self.translations.shape, (n, 3)),
        }
        if self.covariances is not None:
            shapes["covariances"] = (self.covariances.shape, (n, 6, 6))
        for name, (got, expected) in shapes.items():
            if got != expected:
                raise ValueError(f"{name}.shape={got}, expected {expected}")

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def units(self) -> str:
        """``"m"`` or ``"scene"``."""
        return "m" if self.metric else "scene"

    @property
    def centers_in_world(self) -> FloatArray:
        """(N, 3) camera centres."""
        return -np.asarray(np.einsum("nji,nj->ni", self.rotations, self.translations))

    def world_to_cam(self, i: int, points_in_world: FloatArray) -> FloatArray:
        """Moves (..., 3) world points into the camera frame of frame `i`."""
        moved = points_in_world @ self.rotations[i].T + self.translations[i]
        return np.asarray(moved)

    def project(self, i: int, points_in_world: FloatArray) -> FloatArray:
        """(..., 2) pixels of (..., 3) world points in frame `i`; NaN behind the camera."""
        return self.camera.project(self.world_to_cam(i, points_in_world))

    def take(self, rows: Sequence[int] | IntArray) -> Self:
        """The trajectory of the given rows only."""
        rows = np.asarray(rows, dtype=np.int64)
        return replace(
            self,
            indices=self.indices[rows],
            times_s=self.times_s[rows],
            rotations=self.rotations[rows],
            translations=self.translations[rows],
            covariances=None if self.covariances is None else self.covariances[rows],
        )

    def transformed(self, target_from_world: Similarity) -> Self:
        """The same cameras seen from another world frame; the flags are kept."""
        rotations = self.rotations @ target_from_world.rotation.T
        centers = target_from_world(self.centers_in_world)
        covariances = self.covariances
        if covariances is not None:
            unit = np.repeat([1.0, target_from_world.scale], 3)
            covariances = covariances * np.outer(unit, unit)
        return replace(
            self,
            rotations=rotations,
            translations=-np.einsum("nij,nj->ni", rotations, centers),
            covariances=covariances,
        )

    def to_dict(self) -> dict[str, Any]:
        """The content of trajectory.json, schema ``locate.trajectory/1``."""
        quaternions = Rotation.from_matrix(self.rotations).as_quat()
        frames = [
            {
                "index": int(self.indices[i]),
                "time_s": float(self.times_s[i]),
                "cam_from_world": {
                    "rotation_xyzw": quaternions[i].tolist(),
                    "translation": self.translations[i].tolist(),
                },
                "covariance": self._covariance_or_none(i),
            }
            for i in range(len(self))
        ]
        return {
            "schema": SCHEMA,
            "units": self.units,
            "gravity": self.gravity,
            "camera": self.camera.to_dict(),
            "frames": frames,
        }

    def _covariance_or_none(self, i: int) -> list[list[float]] | None:
        if self.covariances is None or not np.isfinite(self.covariances[i]).all():
            return None
        rows: list[list[float]] = self.covariances[i].tolist()
        return rows

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Self:
        """Reads the content of trajectory.json (or of truth.json, which carries the same block).

        Raises:
            BadInputError: Another schema, a key that is missing or has the wrong shape, a pose that
                is not finite, or an index that comes twice.
        """
        schema = content.get("schema")
        if schema not in READABLE_SCHEMAS:
            expected = " or ".join(READABLE_SCHEMAS)
            raise BadInputError(f"trajectory has schema {schema!r}, expected {expected}")
        try:
            frames = sorted(
                content["frames"], key=lambda frame: as_whole_number(frame["index"], "index")
            )
            poses = [f["cam_from_world"] for f in frames]
            covariances = _read_covariances(frames)
            quaternions = as_numbers([p["rotation_xyzw"] for p in poses], "rotation_xyzw")
            translations = as_numbers([p["translation"] for p in poses], "translation")
            found = cls(
                camera=Camera.from_dict(content["camera"]),
                indices=np.array([f["index"] for f in frames], dtype=np.int64),
                times_s=as_numbers([f["time_s"] for f in frames], "time_s"),
                rotations=rotation_of(quaternions.reshape(-1, 4)).as_matrix().reshape(-1, 3, 3),
                translations=translations.reshape(-1, 3),
                covariances=None if np.isnan(covariances).all() else covariances,
                metric=content["units"] == "m",
                gravity=as_truth(content["gravity"], "gravity"),
            )
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise BadInputError(f"trajectory lacks a valid {error}") from error
        found._check_values()
        return found

    def _check_values(self) -> None:
        numbers = np.column_stack([self.times_s, self.translations, self.rotations.reshape(-1, 9)])
        strange = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
        if len(strange):
            index = self.indices[strange[0]]
            raise BadInputError(f"frame {index}: time and pose must be finite numbers")
        self.check_range()
        repeated = np.flatnonzero(np.diff(self.indices) == 0)
        if len(repeated):
            raise BadInputError(f"frame {self.indices[repeated[0]]} comes more than once")

    def check_range(self) -> None:
        """Refuses poses that no camera had in any unit, before they are computed with.

        Raises:
            BadInputError: One is too far away or too uncertain, or all are too close together.
        """
        far = np.flatnonzero(~(np.abs(self.translations) <= FARTHEST).all(axis=1))
        if len(far):
            raise BadInputError(
                f"frame {self.indices[far[0]]}: its camera is over {FARTHEST:g} units from the "
                "origin; give the poses in metres"
            )
        extent = np.ptp(self.centers_in_world, axis=0).max(initial=0) if len(self) else 0.0
        rounding = np.abs(self.translations).max(initial=0) * 1e-12
        if rounding < extent < CLOSEST:
            raise BadInputError(
                f"its cameras are at most {extent:.2g} units apart; give the poses in metres"
            )
        if self.covariances is not None and (np.abs(self.covariances) > MOST_VARIANCE).any():
            raise BadInputError(f"a covariance of a pose is over {MOST_VARIANCE:g}")

    def save(self, path: str | Path) -> None:
        """Writes trajectory.json."""
        Path(path).write_text(json.dumps(self.to_dict(), indent=1))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Reads trajectory.json.

        Raises:
            BadInputError: The file is missing, not JSON, or not a trajectory.
        """
        content = read_json(Path(path))
        if not isinstance(content, dict):
            raise BadInputError(f"{path}: not a trajectory (expected a JSON object)")
        try:
            return cls.from_dict(content)
        except BadInputError as error:
            raise BadInputError(f"{path}: {error}") from error


def _read_covariances(frames: Sequence[dict[str, Any]]) -> FloatArray:
    """(N, 6, 6) of the frames, NaN where there is none."""
    found = np.full((len(frames), 6, 6), np.nan)
    for row, frame in enumerate(frames):
        if frame.get("covariance") is not None:
            found[row] = as_numbers(frame["covariance"], "covariance").reshape(6, 6)
    return found
