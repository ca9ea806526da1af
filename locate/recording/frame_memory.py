"""Frames that stay in memory where a recording is short, so that it is decoded once."""

from collections.abc import Sequence

from locate.recording.index import KeyFrame
from locate.recording.recording import Frame

MOST_BYTES = 1 << 27
"""Most bytes of images that are kept; chosen by hand."""


class FrameMemory:
    """All frames that were read, or none once they take more than `MOST_BYTES`."""

    def __init__(self) -> None:
        self._frames: dict[int, Frame] = {}
        self._free_bytes = MOST_BYTES

    def add(self, frame: Frame) -> None:
        """Keeps a frame while all of them fit."""
        self._free_bytes -= frame.image.nbytes
        if frame.samples is not frame.image:
            self._free_bytes -= frame.samples.nbytes
        if self._free_bytes < 0:
            self._frames.clear()
        else:
            self._frames[frame.index] = frame

    def find(self, chosen: Sequence[KeyFrame]) -> list[Frame] | None:
        """The frames themselves; None where they are not all kept."""
        kept = [self._frames[key.index] for key in chosen if key.index in self._frames]
        return kept if len(kept) == len(chosen) else None
