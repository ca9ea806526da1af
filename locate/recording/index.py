"""The index of the frames that a run works on, beside the PNG files themselves."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import FiniteFloat, NonNegativeInt, PositiveInt

from geometry.arrays import FloatArray, IntArray
from geometry.errors import BadInputError
from geometry.json_values import check_fields
from geometry.text_files import read_json

FRAMES_SCHEMA = "locate.frames/1"
FULL_SIZE = "full"
"""Folder beside the images, of the same frames at full size, under the same names."""


@dataclass(frozen=True, kw_only=True)
class KeyFrame:
    """One kept frame.

    Attributes:
        index: Its index in the video, or in the sorted folder.
        time_s: Its time in the video; the index itself for a folder.
        source: Name of the photo it came from; the video's name for a video.
        sharpness: Variance of the Laplacian, grey levels squared.
        motion_px: Median image motion since the kept frame before, px of the written image;
            0 for the first.
        is_b_frame: Whether a codec made it of frames before and after it, with the fewest bits.
    """

    index: NonNegativeInt
    time_s: FiniteFloat
    source: str
    sharpness: FiniteFloat
    motion_px: FiniteFloat
    is_b_frame: bool = False

    @property
    def name(self) -> str:
        """File name of the written image."""
        return f"{self.index:06d}.png"


@dataclass(frozen=True, kw_only=True)
class KeyFrames:
    """The kept frames of a recording.

    Attributes:
        frames: In order of their index.
        width: Of the written images, px.
        height: Of the written images, px.
        full_width: Of the images in `FULL_SIZE`, px; None where there are none.
        full_height: Likewise.
        is_video: False for a folder of photos.
        static: The camera did not move.
        focal_prior_px: Focal length from metadata in px of the written images, or None.
        focal_source: Where that was found.
        bits_per_pixel: What a video file spends on each pixel of the written images; None for
            other recordings, and where its codec loses nothing.
        codec: Of a video file; None for other recordings.
        warnings: What is wrong with the recording without making it useless.
    """

    frames: tuple[KeyFrame, ...]
    width: PositiveInt
    height: PositiveInt
    is_video: bool
    static: bool
    focal_prior_px: FiniteFloat | None = None
    focal_source: str | None = None
    bits_per_pixel: FiniteFloat | None = None
    codec: str | None = None
    full_width: PositiveInt | None = None
    full_height: PositiveInt | None = None
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def full_size(self) -> tuple[int, int] | None:
        """Width and height of the images in `FULL_SIZE`, px; None where there are none."""
        if self.full_width is None or self.full_height is None:
            return None
        return self.full_width, self.full_height

    @property
    def names(self) -> list[str]:
        """File names of the written images."""
        return [frame.name for frame in self.frames]

    @property
    def indices(self) -> IntArray:
        """(N,) index of each frame in the recording."""
        return np.array([frame.index for frame in self.frames], dtype=np.int64)

    @property
    def b_frames(self) -> IntArray:
        """Indices in the recording of the B frames among them."""
        return self.indices[[frame.is_b_frame for frame in self.frames]]

    @property
    def times_s(self) -> FloatArray:
        """(N,) time of each frame."""
        return np.array([frame.time_s for frame in self.frames], dtype=float)

    def times_of(self, indices: IntArray) -> FloatArray:
        """(N,) times of some of the frames, by their (N,) indices in the recording."""
        return self.times_s[np.searchsorted(self.indices, indices)]

    def save(self, path: Path) -> None:
        """Writes the index as JSON."""
        path.write_text(json.dumps({"schema": FRAMES_SCHEMA, **asdict(self)}, indent=1))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing, not JSON, or of another schema.
        """
        content = read_json(path)
        try:
            schema = content.pop("schema", None) if isinstance(content, dict) else None
            if schema != FRAMES_SCHEMA:
                raise ValueError(f"its schema is {schema!r}, expected {FRAMES_SCHEMA!r}")
            return check_fields(cls, content)
        except (OSError, ValueError) as error:
            raise BadInputError(f"{path}: not a readable frame index ({error})") from error
