"""The bit depth of a recording: which of its frames decide how deep samples are shown in grey."""

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from geometry.arrays import GreySamples
from geometry.errors import BadInputError
from geometry.stretch import MOST_BITS, DeepSamples, Stretch, deep_samples
from locate.recording.container import open_container
from locate.recording.formats import DEEP_SUFFIXES
from locate.recording.images import read_samples
from locate.recording.spacing import spread_rows
from locate.recording.streams import picture_stream

SAMPLED = 9
"""Frames from which the stretch is chosen, spread over the recording."""
MOST_SKIPPED = 250
"""Frames decoded from a key frame on to come to a time: coders set key frames no rarer."""
LAST = 0.95
"""Where in the video the last of these frames is, over its length."""
DEEP_GREY = "gray16le"
"""Format of av with 16 bits of grey; samples of 10 and 12 bits are scaled to fill it."""


def stretch_of_photos(paths: Sequence[Path]) -> Stretch | None:
    """That of photos with deep samples; None where all that were looked at have 8 bits."""
    able = [path for path in paths if path.suffix.lower() in DEEP_SUFFIXES]
    return Stretch.choose(_deep_photos([able[row] for row in spread_rows(len(able), SAMPLED)]))


def stretch_of_video(path: Path) -> Stretch | None:
    """That of a video of more than 8 bits; None where its 8 highest bits are used well."""
    stretch = Stretch.choose(_deep_video_frames(path), bits=MOST_BITS)
    return None if stretch is None or stretch.is_whole_range else stretch


def stretch_notes(path: Path, stretch: Stretch | None) -> list[str]:
    """What a map says of the stretch of a recording; empty without one."""
    return [] if stretch is None else [f"{path.name}: {stretch.note}"]


def grey_of_frame(frame: av.VideoFrame, stretch: Stretch | None) -> GreySamples:
    """The (H, W) image of a decoded frame, as deep as it is, deep samples stretched."""
    if not _is_deep(frame):
        return np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
    deep = _deep_grey(frame)
    return deep if stretch is None else stretch.apply_finely(deep)


def _deep_photos(paths: Sequence[Path]) -> Iterator[DeepSamples]:
    for path in paths:
        try:
            samples = deep_samples(read_samples(path))
        except BadInputError:
            continue  # said by name when it is read as a frame
        if samples is not None:
            yield samples


def _deep_video_frames(path: Path) -> Iterator[NDArray[np.uint16]]:
    with open_container(path) as container:
        picture_stream(container).thread_type = "AUTO"
        for frame in _spread_frames(container):
            if not _is_deep(frame):
                return
            yield _deep_grey(frame)


def _spread_frames(container: Any) -> Iterator[av.VideoFrame]:
    """Frames at evenly spread times; of a file that does not know its length, the first ones."""
    start, length = container.start_time or 0, container.duration or 0
    if not length:
        yield from islice(
            container.decode(picture_stream(container)), 0, MOST_SKIPPED, MOST_SKIPPED // SAMPLED
        )
        return
    for time in np.linspace(0, LAST * length, SAMPLED):
        frame = _frame_at(container, start + int(time))
        if frame is not None:
            yield frame


def _frame_at(container: Any, time: int) -> av.VideoFrame | None:
    """The first frame from this time on, or one soon after the key frame before it."""
    frame = None
    try:
        container.seek(time, backward=True)
        for frame in islice(container.decode(picture_stream(container)), MOST_SKIPPED):
            if frame.time is None or frame.time * av.time_base >= time:
                break
    except (OSError, ValueError, av.error.FFmpegError):
        pass  # damage is noted when the frames are read
    return frame


def _deep_grey(frame: av.VideoFrame) -> NDArray[np.uint16]:
    return np.asarray(frame.to_ndarray(format=DEEP_GREY), dtype=np.uint16)


def _is_deep(frame: av.VideoFrame) -> bool:
    return any(component.bits > 8 for component in frame.format.components)
