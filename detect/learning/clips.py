"""What the learned registered detector learns from: features of frames, and the truth."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import BoolArray
from geometry.npz import check_numbers, open_arrays, save_arrays

Leaks = Literal["nozzle", "anywhere"]
"""Where the plumes of simulated clips leave."""
PLUME_SHARE = 0.3
MOST_PX = 4.0
"""Displacements are distinguished up to this; a camera inside a plume sees hundreds of px."""
LEAST_PLUME_PX, STILL_PX = 0.02, 0.01
KINDS = ("plume-free", "faint", "weak", "strong")
STRENGTHS_PX = (0.0, 0.15, 0.5)
"""Amplitudes up to which a training clip is of the first kinds."""


@dataclass(frozen=True, kw_only=True)
class TrainingClip:
    """K key frames of one scene.

    Attributes:
        inputs: (K, C, H, W) float16, the channels of `detect.registered.features`.
        displacements: (K, H, W, 2) float16, px, true.
        surface: (K, H, W) false in the sky, where nothing can be displaced.
        amplitude_px: 95th percentile of |w| over the plume; 0 without one.
    """

    inputs: NDArray[np.float16]
    displacements: NDArray[np.float16]
    surface: BoolArray
    amplitude_px: float

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def kind(self) -> int:
        """Index into `KINDS`, by the plume's strength."""
        return int(np.searchsorted(STRENGTHS_PX, self.amplitude_px))

    @property
    def limits_px(self) -> tuple[float, float]:
        """Displacements above the first are plume, below the second none, between neither.

        What is much weaker than the plume itself nobody is asked to see.
        """
        return max(PLUME_SHARE * self.amplitude_px, LEAST_PLUME_PX), STILL_PX

    def visible_displacements(self) -> NDArray[np.float16]:
        """(K, H, W, 2) px, 0 in the sky, either component at most `MOST_PX`."""
        clipped = self.displacements.clip(-MOST_PX, MOST_PX)
        return np.where(self.surface[..., None], clipped, np.float16(0))

    def save(self, path: Path) -> None:
        """Writes all or nothing."""
        save_arrays(
            path,
            inputs=self.inputs,
            displacements=self.displacements,
            surface=np.packbits(self.surface, axis=-1),
            amplitude_px=np.array(self.amplitude_px),
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing or broken.
        """
        with open_arrays(path, "a training clip") as file:
            inputs = file["inputs"]
            displacements = file["displacements"]
            amplitude = file["amplitude_px"]
            check_numbers(inputs=inputs, displacements=displacements, amplitude_px=amplitude)
            surface = np.unpackbits(file["surface"], axis=-1, count=inputs.shape[-1])
            return cls(
                inputs=inputs,
                displacements=displacements,
                surface=surface.astype(bool),
                amplitude_px=float(amplitude),
            )


def check_clip(path: Path) -> None:
    """Checks that a training clip has all its arrays and is not cut short; they are not read.

    Raises:
        BadInputError: It is missing or broken.
    """
    with open_arrays(path, "a training clip") as file:
        missing = {"inputs", "displacements", "surface", "amplitude_px"} - set(file.files)
        if missing:
            raise KeyError(min(missing))


def clip_path(folder: Path, seed: int) -> Path:
    """The file of the clip of a seed."""
    return folder / f"lesson_{seed:06d}.npz"


def list_clips(folder: Path) -> list[Path]:
    """The clips of a folder, in order."""
    return sorted(folder.glob("lesson_*.npz"))


def clip_seed(path: Path) -> int:
    """The seed of a training clip, by its name."""
    return int(path.stem.removeprefix("lesson_"))
