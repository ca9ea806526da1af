"""What a detector sees in one frame, and the one method every detector has."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from detect.information import DisplacementInformation
from detect.response import Response
from geometry.arrays import FloatMap, GreyImage, IntArray
from geometry.errors import BadInputError
from geometry.npz import as_float32, read_npz, save_arrays
from geometry.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Frames:
    """The frames of one recording, undistorted, read on demand.

    Attributes:
        images: N grey images, (H, W) uint8; `images[i]` may decode or read a file.
        trajectory: Their N poses and the pinhole camera; None where the camera stood still or
            its motion is unknown.
        full_size: The same frames with more pixels, undistorted, N images (H', W') of float32 grey
            levels; None where there are none.
        b_frames: Rows of the B frames: a codec made them of frames before and after, with the
            fewest bits.
    """

    images: Sequence[GreyImage]
    trajectory: Trajectory | None = None
    full_size: Sequence[FloatMap] | None = None
    b_frames: Sequence[int] | IntArray = ()

    def __len__(self) -> int:
        return len(self.images)


@dataclass(frozen=True, kw_only=True)
class Detection:
    """The refraction seen in one frame.

    Attributes:
        displacement: (H, W, 2) px, x right, y down: pixel p shows the background that would stand
            at p + displacement(p) without the plume.
        sigma_px: (H, W) standard deviation of either component, px; inf where nothing was measured.
        llr: (H, W) natural-log likelihood ratio of refraction against none; 0 is no evidence.
        inverse_depth: (H, W) of the background along the optical axis, 1 / world unit; 0 at
            infinity, NaN where unknown. None where the detector does not measure it.
        information: Normal equations of the displacement, of all pixels, on fewer cells; None
            where the detector does not measure it, or could not in this frame.
    """

    displacement: FloatMap
    sigma_px: FloatMap
    llr: FloatMap
    inverse_depth: FloatMap | None = None
    information: DisplacementInformation | None = None

    def __post_init__(self) -> None:
        shape = self.llr.shape
        if self.displacement.shape != (*shape, 2) or self.sigma_px.shape != shape:
            raise ValueError(
                f"{self.displacement.shape=} and {self.sigma_px.shape=} do not fit {shape=}"
            )

    @classmethod
    def without_evidence(cls, shape: tuple[int, ...], *, depth: bool = False) -> Self:
        """Of a frame, (H, W), that nothing could be measured in.

        Args:
            shape: Of the frame.
            depth: Whether the detector measures depth, which is unknown then.
        """
        return cls(
            displacement=np.zeros((*shape, 2), np.float32),
            sigma_px=np.full(shape, np.inf, np.float32),
            llr=np.zeros(shape, np.float32),
            inverse_depth=np.full(shape, np.nan, np.float32) if depth else None,
        )

    def save(self, path: str | Path) -> None:
        """Writes an .npz, whole or not at all: float16, the information float32, uncompressed.

        What float16 cannot hold becomes infinite.
        """
        arrays = {"displacement": self.displacement, "sigma_px": self.sigma_px, "llr": self.llr}
        if self.inverse_depth is not None:
            arrays["inverse_depth"] = self.inverse_depth
        with np.errstate(over="ignore"):
            halves = {name: array.astype(np.float16) for name, array in arrays.items()}
        terms: dict[str, FloatMap] = {}
        if self.information is not None:
            terms["information_vector"] = self.information.vector
            terms["information_matrix"] = self.information.matrix
        save_arrays(Path(path), np.savez, **halves, **terms)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing, broken, or not a detection.
        """
        arrays = read_npz(Path(path))
        try:
            maps = {name: as_float32(array) for name, array in arrays.items()}
            vector = maps.pop("information_vector", None)
            matrix = maps.pop("information_matrix", None)
            detection = cls(**maps)  # type: ignore[arg-type]
            if vector is None and matrix is None:
                return detection
            if vector is None or matrix is None:
                raise ValueError("of the information one half is missing")
            return replace(
                detection, information=DisplacementInformation(vector=vector, matrix=matrix)
            )
        except (TypeError, ValueError) as error:
            raise BadInputError(f"{path}: not a detection ({error})") from error


class Detector(Protocol):
    """Anything that sees refraction in a frame.

    Attributes:
        name: Its name.
        response: What evidence it gives a displacement; None: that of
            `detect.evidence.log_likelihood_ratio`.
    """

    name: str
    response: Response | None

    @property
    def uses_other_frames(self) -> bool:
        """Whether a frame is measured by means of the others."""
        ...

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index`; others may be its neighbours or its reference."""
        ...
