"""A video file, frame by frame as a player shows it: in time, shape, fields and orientation."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
from av.video.frame import PictureType
from numpy.typing import NDArray

from geometry.arrays import GreySamples, Picture
from geometry.errors import BadInputError
from geometry.stretch import Stretch
from locate.recording.container import UNREADABLE, open_video, start_of_video_s
from locate.recording.depth import grey_of_frame
from locate.recording.display import PictureGeometry
from locate.recording.fields import FILTER, merge_fields
from locate.recording.groups import decode_chosen
from locate.recording.streams import describe_other_streams, picture_stream

CODED_FRAMES = 300
"""Frames that show how a video is coded: some seconds, with whole frames among them."""
MISSING_TAIL_S = 0.5
"""Missing end of a video from which on it counts as truncated."""
GAP = 2.5
"""Step between two frames, over the usual one, from which on some may be missing; chosen."""


class LeftOutError(Exception):
    """An image that is no frame of the recording; its reader notes why."""


class NamedImage(NamedTuple):
    """An image of a recording.

    Attributes:
        time_s: From the first one.
        name: Of what it comes from.
        load: Gives it, (H, W) as deep as it is, until the next one is asked for, or raises
            `LeftOutError`.
        is_b_frame: Whether a codec made it of frames before and after it, with the fewest bits.
    """

    time_s: float
    name: str
    load: Callable[[], GreySamples]
    is_b_frame: bool = False


def _declared_end_s(container: "av.container.InputContainer") -> float:
    """When the file says that it ends, on the clock of its streams; 0 where it does not."""
    duration_s = (container.duration or 0) / av.time_base
    if "matroska" in container.format.name or not duration_s:  # its duration counts from zero
        return duration_s
    return duration_s + (container.start_time or 0) / av.time_base


def read_video_header(path: Path) -> tuple[dict[str, str], int]:
    """Metadata, and the number of frames by the stream or by the duration; 0 where unknown."""
    with open_video(path) as container:
        stream = picture_stream(container)
        length_s = _declared_end_s(container) - start_of_video_s(container)
        count = stream.frames or round(length_s * float(stream.average_rate or 0))
        return container.metadata | stream.metadata, max(0, count)


@dataclass(frozen=True, kw_only=True)
class VideoCoding:
    """How a video is coded.

    Attributes:
        codec: Its name, as FFmpeg knows it.
        loses: Whether it can lose anything.
        bits_per_frame: Mean over the first frames; 0 where there are none.
    """

    codec: str
    loses: bool
    bits_per_frame: float


def read_coding(path: Path) -> VideoCoding:
    """How a video is coded, by its stream and its first frames."""
    with open_video(path) as container:
        stream = picture_stream(container)
        packets = islice(container.demux(stream), CODED_FRAMES)
        sizes = [packet.size for packet in packets if packet.size]
        codec = stream.codec_context.codec
        return VideoCoding(
            codec=codec.name,
            loses=codec.lossy,
            bits_per_frame=8 * sum(sizes) / max(1, len(sizes)),
        )


def first_video_image(path: Path) -> GreySamples:
    """The first frame.

    Raises:
        BadInputError: Not one can be decoded.
    """
    for image in video_images(path, []):
        return image.load()
    raise BadInputError(f"{path}: not one frame of this video can be decoded")


def video_images(
    path: Path, warnings: list[str], stretch: Stretch | None = None
) -> Iterator[NamedImage]:
    """Decodes what there is; times count from the first frame.

    An early end, and what was done to show the frames as a player does, is noted in `warnings`,
    not raised.
    """
    times_s: list[float] = []
    geometry, rotation = None, 0
    with open_video(path) as container:
        stream = picture_stream(container)
        stream.thread_type = "AUTO"
        rate = float(stream.average_rate or 25)
        start_s = start_of_video_s(container)
        length_s = _declared_end_s(container) - start_s
        decoded = _DecodedFrames(container=container, stream=stream)
        for frame in merge_fields(decoded.frames()):
            time_s = frame.time - start_s if frame.time is not None else len(times_s) / rate
            times_s.append(time_s)
            if geometry is None or frame.rotation != rotation:
                # Side data keep their frame until Python looks for cycles, hundreds of frames on.
                geometry, rotation = PictureGeometry.of(frame, stream), frame.rotation
            if len(times_s) == 1:
                notes = geometry.describe(grey_of_frame(frame, stretch))
                _add_notes(warnings, path, [*describe_other_streams(container), *notes])
            load = partial(_show, frame, geometry, stretch)
            yield NamedImage(time_s, path.name, load, frame.pict_type == PictureType.B)
    if decoded.interlaced:
        _add_notes(warnings, path, [f"its frames are interlaced; {FILTER} deinterlaced them"])
    last_s = times_s[-1] if times_s else 0.0
    if decoded.broken or (times_s and length_s - last_s - 1 / rate > MISSING_TAIL_S):
        note = f"damaged or truncated; {len(times_s)} frames decoded, up to {last_s:.2f} s"
        _add_notes(warnings, path, [note])
    _add_notes(warnings, path, _describe_gaps(times_s))


def _show(frame: av.VideoFrame, geometry: PictureGeometry, stretch: Stretch | None) -> GreySamples:
    return geometry.show(grey_of_frame(frame, stretch))


def find_gaps(times: Sequence[float], factor: float) -> NDArray[np.intp]:
    """Which steps between times are longer than `factor` times the usual one."""
    steps = np.diff(times)
    usual = np.median(steps) if len(steps) else 0.0
    return np.flatnonzero(steps > factor * usual)


def _describe_gaps(times_s: list[float]) -> list[str]:
    """A note on steps between frames that are far longer than the usual one; none without."""
    steps_s, gaps = np.diff(times_s), find_gaps(times_s, GAP)
    if not len(gaps):
        return []
    longest = int(gaps[np.argmax(steps_s[gaps])])
    return [
        f"{len(gaps)} of its {len(steps_s)} steps between frames are over {GAP:g} times the usual "
        f"one (the longest {steps_s[longest]:.2f} s, at {times_s[longest]:.2f} s): it was recorded "
        "unevenly, or frames are lost and those after them may be spoilt"
    ]


def chosen_video_images(
    path: Path, times_s: Sequence[float], stretch: Stretch | None
) -> Iterator[NamedImage]:
    """The frames of some times, as `video_images` gives them, without decoding all.

    Only up to the first that is not found, and not surely those frames: `decode_chosen`.

    Args:
        path: The video.
        times_s: Of the frames, rising.
        stretch: As for `video_images`.
    """
    for time_s, (frame, stream) in zip(times_s, decode_chosen(path, times_s), strict=False):
        load = partial(_show, frame, PictureGeometry.of(frame, stream), stretch)
        yield NamedImage(time_s, path.name, load, frame.pict_type == PictureType.B)


def video_pictures(path: Path, times_s: Mapping[int, float]) -> Iterator[tuple[int, Picture]]:
    """Some frames in colour, as a player shows them.

    Args:
        path: The video.
        times_s: Of each wanted frame, by its number; both rise.

    Yields:
        Number and picture, (H, W, 3) blue, green, red; none of what cannot be decoded.
    """
    waiting = dict(times_s)
    for index, (frame, stream) in zip(
        times_s, decode_chosen(path, list(times_s.values())), strict=False
    ):
        del waiting[index]
        yield index, _show_in_colour(frame, stream)
    if not waiting:
        return
    with open_video(path) as container:
        stream = picture_stream(container)
        stream.thread_type = "AUTO"
        decoded = _DecodedFrames(container=container, stream=stream)
        frames = islice(merge_fields(decoded.frames()), max(waiting) + 1)
        for index, frame in enumerate(frames):
            if index in waiting:
                yield index, _show_in_colour(frame, stream)


def _show_in_colour(frame: av.VideoFrame, stream: av.VideoStream) -> Picture:
    stored = np.asarray(frame.to_ndarray(format="bgr24"), dtype=np.uint8)
    return np.asarray(PictureGeometry.of(frame, stream).show(stored), dtype=np.uint8)


@dataclass(kw_only=True)
class _DecodedFrames:
    """The frames of a stream that decode, up to where none does.

    Attributes:
        container: The file.
        stream: Of it.
        broken: Some did not, among those read so far.
        interlaced: Some are of two fields, among those read so far.
    """

    container: "av.container.InputContainer"
    stream: "av.VideoStream"
    broken: bool = False
    interlaced: bool = False

    def frames(self) -> Iterator[av.VideoFrame]:
        try:
            for frame in self.container.decode(self.stream):
                if frame.is_corrupt:
                    self.broken = True
                    continue
                self.interlaced |= frame.interlaced_frame
                yield frame
        except UNREADABLE:
            self.broken = True


def _add_notes(warnings: list[str], path: Path, notes: list[str]) -> None:
    """Adds what is not noted yet; a video is read more than once."""
    named = (f"{path.name}: {note}" for note in notes)
    warnings.extend(note for note in named if note not in warnings)
