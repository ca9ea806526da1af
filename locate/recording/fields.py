"""Interlaced video: two fields, half a frame apart in time, made one picture."""

from collections.abc import Iterator
from contextlib import suppress

import av

FILTER = "bwdif" if "bwdif" in av.filter.filters_available else "yadif"
"""The deinterlacer: the better one where this FFmpeg has it."""


def merge_fields(frames: Iterator[av.VideoFrame]) -> Iterator[av.VideoFrame]:
    """The frames, interlaced ones deinterlaced, at the time of their first field.

    Progressive frames before the first interlaced one pass as they are, those after it through the
    filter, which leaves them alone.
    """
    graph: av.filter.Graph | None = None
    layout: tuple[int, int, str] | None = None
    for frame in frames:
        if graph is None and not frame.interlaced_frame:
            yield frame
            continue
        here = (frame.width, frame.height, frame.format.name)
        if graph is None or here != layout:
            if graph is not None:
                yield from _push(graph, None)
            graph, layout = _make_graph(frame), here
        yield from _push(graph, frame)
    if graph is not None:
        yield from _push(graph, None)


def _make_graph(frame: av.VideoFrame) -> av.filter.Graph:
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    graph.link_nodes(
        source, graph.add(FILTER, "mode=send_frame:deint=interlaced"), graph.add("buffersink")
    ).configure()
    return graph


def _push(graph: av.filter.Graph, frame: av.VideoFrame | None) -> Iterator[av.VideoFrame]:
    graph.vpush(frame)
    with suppress(av.error.BlockingIOError, av.error.EOFError):
        while True:
            yield graph.vpull()
