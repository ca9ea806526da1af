"""Chosen frames of a video: groups of pictures that hold none of them are not decoded.

A codec makes the frames of a group from its first one, which stands alone, and from one another;
frames that are shown before the first one need the group before it, too.
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import av

from locate.recording.container import UNREADABLE, open_video, start_of_video_s
from locate.recording.streams import picture_stream


def decode_chosen(
    path: Path, times_s: Sequence[float]
) -> Iterator[tuple[av.VideoFrame, av.VideoStream]]:
    """Decodes the frames of some times, in order, up to the first that is not there.

    Whether these are the frames that decoding all would give is for the caller to check: a file
    can name frames as standing alone that do not.

    Args:
        path: The video.
        times_s: From its start, as decoding all gives them; rising.

    Yields:
        Each frame, with its stream. None are interlaced: what a deinterlacer makes of a frame
        depends on its neighbours.
    """
    wanted = [_microseconds(time_s) for time_s in times_s]
    groups = _groups_of(path, set(wanted))
    with open_video(path) as container:
        stream = picture_stream(container)
        stream.thread_type = "AUTO"
        start_s = start_of_video_s(container)
        waiting = iter(wanted)
        next_us = next(waiting, None)
        for frame in _decode_groups(container, stream, groups):
            if next_us is None or frame.time is None or frame.interlaced_frame:
                return
            shown_us = _microseconds(frame.time - start_s)
            if shown_us > next_us:
                return
            if shown_us == next_us and not frame.is_corrupt:
                yield frame, stream
                next_us = next(waiting, None)


def _groups_of(path: Path, wanted_us: Collection[int]) -> set[int]:
    """Numbers of the groups without which the frames of these times cannot be decoded."""
    group, first_pts = -1, 0
    needed: set[int] = set()
    with open_video(path) as container:
        stream = picture_stream(container)
        start_s = start_of_video_s(container)
        for packet in _packets(container, stream):
            group += packet.is_keyframe
            if packet.pts is None or packet.time_base is None:
                continue
            if packet.is_keyframe:
                first_pts = packet.pts
            if _microseconds(float(packet.pts * packet.time_base) - start_s) in wanted_us:
                needed |= {group} if packet.pts >= first_pts else {group - 1, group}
    return needed


def _decode_groups(
    container: "av.container.InputContainer", stream: av.VideoStream, groups: Collection[int]
) -> Iterator[av.VideoFrame]:
    """The frames of some groups; of each as many as there are before one that is damaged."""
    group, is_open = -1, False
    try:
        for packet in _packets(container, stream):
            group += packet.is_keyframe
            if group in groups:
                is_open = True
                yield from stream.decode(packet)
            elif is_open:
                is_open = False
                yield from _flush(stream)
        if is_open:
            yield from _flush(stream)
    except UNREADABLE:
        return


def _packets(
    container: "av.container.InputContainer", stream: av.VideoStream
) -> Iterator["av.Packet[av.VideoStream]"]:
    return (packet for packet in container.demux(stream) if packet.size)


def _flush(stream: av.VideoStream) -> Iterator[av.VideoFrame]:
    """The frames that the decoder still holds; it is then ready for another group."""
    end = av.Packet()
    if stream.time_base is not None:
        end.time_base = stream.time_base
    yield from stream.decode(end)
    stream.codec_context.flush_buffers()


def _microseconds(time_s: float) -> int:
    return round(time_s * 1e6)
