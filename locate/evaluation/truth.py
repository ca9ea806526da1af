"""The truth of a simulated scene."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, Field

from geometry.arrays import BoolArray, FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.json_values import check_fields
from geometry.npz import as_float32, read_npz
from geometry.text_files import read_json
from geometry.trajectory import FARTHEST, Trajectory

_Length = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
_Vector = tuple[_Length, _Length, _Length]


class _PlumeBlock(BaseModel):
    source: _Vector
    axis: _Vector


class _TruthBlock(BaseModel):
    plumes: list[_PlumeBlock]


@dataclass(frozen=True, kw_only=True)
class TruthFrame:
    """Ground truth of one frame: (H, W, 2) px and (H, W) bool."""

    displacement: FloatMap
    mask: BoolArray


@dataclass(frozen=True, kw_only=True)
class SceneTruth:
    """Ground truth of a scene.

    Attributes:
        folder: Where it lies: truth.json, and truth/000000.npz and so on.
        trajectory: The true cameras.
        sources: (P, 3) of the plumes, in the true world.
        axes: (P, 3) unit vectors of their rise.
    """

    folder: Path
    trajectory: Trajectory
    sources: FloatArray
    axes: FloatArray

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads truth.json of a folder made by ``locate simulate``.

        Raises:
            BadInputError: The file is missing or is not the truth of a scene.
        """
        path = folder / "truth.json"
        trajectory = Trajectory.load(path)
        try:
            plumes = check_fields(_TruthBlock, read_json(path)).plumes
        except ValueError as error:
            raise BadInputError(f"{path}: {error}") from error
        axes = np.reshape([plume.axis for plume in plumes], (-1, 3)).astype(float)
        return cls(
            folder=folder,
            trajectory=trajectory,
            sources=np.reshape([plume.source for plume in plumes], (-1, 3)).astype(float),
            axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        )

    @cached_property
    def ranges(self) -> FloatArray:
        """(P,) median distance from the cameras to each source."""
        rays = self.sources[:, None] - self.trajectory.centers_in_world
        return np.asarray(np.median(np.linalg.norm(rays, axis=-1), axis=1))

    def frame(self, index: int) -> TruthFrame | None:
        """The truth of a frame; None where none was written.

        Raises:
            BadInputError: The file is broken or not the truth of a frame.
        """
        path = self.folder / "truth" / f"{index:06d}.npz"
        if not path.is_file():
            return None
        arrays = read_npz(path)
        try:
            displacement, mask = as_float32(arrays["displacement"]), arrays["mask"] > 0
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"{path}: not the truth of a frame ({error!r})") from error
        if mask.ndim != 2 or displacement.shape != (*mask.shape, 2):
            raise BadInputError(
                f"{path}: displacement is {displacement.shape}, mask {mask.shape}; "
                "expected (H, W, 2) and (H, W)"
            )
        return TruthFrame(displacement=displacement, mask=mask)
