"""The index of the frames that a run works on, beside the PNG files themselves."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.errors import BadInputError
from geometry.json_text import parse_json

FRAMES_SCHEMA = "locate.frames/1"


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
    """

    index: int
    time_s: float
    source: str
    sharpness: float
    motion_px: float

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
        is_video: False for a folder of photos.
        static: The camera did not move.
        focal_prior_px: Focal length from metadata in px of the written images, or None.
        focal_source: Where that was found.
        warnings: What is wrong with the recording without making it useless.
    """

    frames: tuple[KeyFrame, ...]
    width: int
    height: int
    is_video: bool
    static: bool
    focal_prior_px: float | None = None
    focal_source: str | None = None
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def names(self) -> list[str]:
        """File names of the written images."""
        return [frame.name for frame in self.frames]

    @property
    def indices(self) -> IntArray:
        """(N,) index of each frame in the recording."""
        return np.array([frame.index for frame in self.frames], dtype=np.int64)

    @property
    def times_s(self) -> FloatArray:
        """(N,) time of each frame."""
        return np.array([frame.time_s for frame in self.frames], dtype=float)

    def save(self, path: Path) -> None:
        """Writes the index as JSON."""
        path.write_text(json.dumps({"schema": FRAMES_SCHEMA, **asdict(self)}, indent=1))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing, not JSON, or of another schema.
        """
        try:
            content: dict[str, Any] = parse_json(path.read_text())
            if content.pop("schema") != FRAMES_SCHEMA:
                raise ValueError(f"expected schema {FRAMES_SCHEMA}")
            frames = tuple(KeyFrame(**frame) for frame in content.pop("frames"))
            return cls(frames=frames, warnings=tuple(content.pop("warnings")), **content)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise BadInputError(f"{path}: not a readable frame index ({error})") from error
