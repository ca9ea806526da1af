"""Telemetry in the subtitle track of the video itself."""

from collections.abc import Iterator
from pathlib import Path

import av
from av.stream import Discard

from geometry.errors import BadInputError, report_as_bad_input
from geometry.text_files import MOST_TEXT_BYTES
from locate.recording.container import open_container, start_of_video_s
from locate.telemetry.dji_srt import track_of_cues
from locate.telemetry.track import TelemetryTrack

KIND = "video subtitle"


def read_subtitles(path: Path) -> TelemetryTrack:
    """Reads the first subtitle track of a video; times count from its first frame.

    Raises:
        BadInputError: Not a readable video, no text subtitles, or none that holds a position.
    """
    with report_as_bad_input(path, "video file"), open_container(path) as container:
        if not container.streams.subtitles:
            raise BadInputError(
                f"{path}: no telemetry inside this video; give a .SRT, GPX, CSV or log beside it"
            )
        return track_of_cues(_read_cues(path, container), path, KIND)


def _read_cues(path: Path, container: "av.container.InputContainer") -> Iterator[tuple[float, str]]:
    stream = container.streams.subtitles[0]
    for other in container.streams:
        if other.index != stream.index:
            other.discard = Discard.all  # so that gigabytes of images are not read
    start_s, left = start_of_video_s(container), MOST_TEXT_BYTES
    for packet in container.demux(stream):
        content = bytes(packet)
        if packet.pts is None or not content:
            continue
        left -= len(content)
        if left < 0:
            most = f"{MOST_TEXT_BYTES // 2**20} MiB"
            raise BadInputError(f"{path}: its subtitle track is over {most}; cut the video")
        if stream.codec_context.name == "mov_text":  # two bytes of length, 3GPP TS 26.245
            content = content[2 : 2 + int.from_bytes(content[:2], "big")]
        time_s = float(packet.pts * packet.time_base) - start_s
        yield time_s, content.decode("utf-8", errors="replace")
