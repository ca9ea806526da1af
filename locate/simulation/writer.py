"""The files of a simulated recording: the video, and the truth beside it."""

import json
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

import numpy as np

from geometry.arrays import GreyImage
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.image_files import write_image
from geometry.npz import save_arrays
from geometry.trajectory import Trajectory
from locate.recording.writer import H264, LOSSLESS, create_video
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import RenderedTruth
from locate.simulation.scene import VideoBlock

SCHEMA = "locate.truth/1"
LARGEST_HALF = 6e4


class FrameSink(Protocol):
    """Takes frames one after the other."""

    def write(self, image: GreyImage) -> None:
        """Appends a frame."""
        ...


def create_recording(
    folder: Path, video: VideoBlock, camera: Camera
) -> AbstractContextManager[FrameSink]:
    """Creates DIR/video.mkv (FFV1, lossless) or DIR/video.mp4 (H.264), complete after the block."""
    lossless = video.codec == "ffv1"
    return create_video(
        folder / ("video.mkv" if lossless else "video.mp4"),
        size=(camera.width, camera.height),
        fps=video.fps,
        codec=LOSSLESS if lossless else H264,
        options={} if lossless else {"crf": str(video.crf)},
    )


class PngFrameFolder:
    """DIR/frames/000000.png and so on."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "frames"
        self._folder.mkdir(exist_ok=True)
        self._count = 0

    def write(self, image: GreyImage) -> None:
        """Appends a frame."""
        write_image(self._folder / f"{self._count:06d}.png", image)
        self._count += 1


def make_folder(folder: Path) -> None:
    """Makes DIR and DIR/truth.

    Raises:
        BadInputError: It cannot be made.
    """
    try:
        (folder / "truth").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"{folder}: cannot be made a folder ({error})") from error


def write_truth(folder: Path, index: int, truth: RenderedTruth) -> None:
    """DIR/truth/{index:06d}.npz: displacement and depth as float16, mask as bool."""
    depth = np.where(truth.depth > LARGEST_HALF, np.inf, truth.depth).astype(np.float16)
    save_arrays(
        folder / "truth" / f"{index:06d}.npz",
        displacement=truth.displacement.astype(np.float16),
        mask=truth.mask,
        depth=depth,
    )


def write_summary(
    folder: Path,
    trajectory: Trajectory,
    fields: Sequence[PlumeField],
    amplitudes_px: Sequence[float],
) -> None:
    """DIR/truth.json: the trajectory block, and the plumes."""
    plumes = [
        {
            "source": list(field.plume.source),
            "axis": field.axis_in_world.tolist(),
            "gas": field.plume.gas,
            "amplitude_px": amplitude,
            "radius": field.plume.radius_m,
            "height": field.plume.height_m,
            "refractivity_gain": field.gain,
        }
        for field, amplitude in zip(fields, amplitudes_px, strict=True)
    ]
    content = trajectory.to_dict() | {"schema": SCHEMA, "plumes": plumes}
    (folder / "truth.json").write_text(json.dumps(content, indent=1))
