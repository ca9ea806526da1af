"""The files of a simulated recording: the video, and the truth beside it."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import av
import cv2
import numpy as np

from geometry.arrays import GreyImage
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.simulation.plume import PlumeField
from locate.simulation.render import Truth
from locate.simulation.scene import VideoBlock

SCHEMA = "locate.truth/1"
LARGEST_HALF = 6e4


class FrameSink(Protocol):
    """Takes frames one after the other."""

    def write(self, image: GreyImage) -> None:
        """Appends a frame."""
        ...


class _Video:
    def __init__(self, container: Any, stream: Any) -> None:
        self._container = container
        self._stream = stream
        self._count = 0

    def write(self, image: GreyImage) -> None:
        frame = av.VideoFrame.from_ndarray(image, format="gray")
        frame.pts = self._count
        frame.time_base = self._stream.codec_context.time_base
        self._count += 1
        if self._stream.codec_context.pix_fmt != "gray":
            frame = frame.reformat(format=self._stream.codec_context.pix_fmt)
        self._container.mux(self._stream.encode(frame))


@contextmanager
def open_video(folder: Path, video: VideoBlock, camera: Camera) -> Iterator[FrameSink]:
    """DIR/video.mkv (FFV1, lossless) or DIR/video.mp4 (H.264), complete when the block ends."""
    lossless = video.codec == "ffv1"
    path = folder / ("video.mkv" if lossless else "video.mp4")
    rate = Fraction(video.fps).limit_denominator(1001)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1" if lossless else "libx264", rate=rate)
        stream.width, stream.height = camera.width, camera.height
        stream.pix_fmt = "gray" if lossless else "yuv420p"
        stream.codec_context.time_base = 1 / rate
        if not lossless:
            stream.options = {"crf": str(video.crf)}
        yield _Video(container, stream)
        container.mux(stream.encode())


class FrameFolder:
    """DIR/frames/000000.png and so on."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "frames"
        self._folder.mkdir(exist_ok=True)
        self._count = 0

    def write(self, image: GreyImage) -> None:
        """Appends a frame."""
        path = self._folder / f"{self._count:06d}.png"
        if not cv2.imwrite(str(path), image):
            raise BadInputError(f"{path}: cannot be written")
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


def write_truth(folder: Path, index: int, truth: Truth) -> None:
    """DIR/truth/{index:06d}.npz: displacement and depth as float16, mask as bool."""
    depth = np.where(truth.depth > LARGEST_HALF, np.inf, truth.depth).astype(np.float16)
    with (folder / "truth" / f"{index:06d}.npz").open("wb") as file:
        np.savez_compressed(
            file,
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
