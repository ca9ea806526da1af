"""What a recording is, as far as its file states it."""

from collections.abc import Iterator
from pathlib import Path

from geometry.errors import BadInputError
from locate.pipeline.obstacles import FEWEST_FRAMES, FINE_CODING
from locate.recording import Recording
from locate.recording.container import open_video
from locate.telemetry import read_telemetry, telemetry_candidates

SLOW_FPS = 10.0
Fact = tuple[str, str]


def recording_facts(recording: Recording) -> Iterator[Fact]:
    """What the file states of its frames, and their size in a run: quantity and value."""
    yield "frames", str(recording.expected_frames or "a number that the file does not state")
    yield "size", _describe_sizes(recording)
    if recording.coding is not None:
        yield from _video_facts(recording.path)
    bits = recording.bits_per_pixel
    if bits is not None:
        yield "coded with", f"{bits:.2f} bits a pixel of {recording.width}x{recording.height}"
    prior = recording.focal
    if prior is None:
        yield "focal length", "not stated; it is estimated, or give --focal or --camera"
    else:
        own_px = prior.relative * max(recording.sizes.source)
        yield "focal length", f"{own_px:.0f} px ({prior.source})"
    if recording.read is None:
        yield "telemetry", describe_telemetry(recording.path)


def odd_things(recording: Recording) -> Iterator[str]:
    """What makes a run of this recording less likely to show anything."""
    yield from recording.warnings
    if 0 < recording.expected_frames < FEWEST_FRAMES:
        yield (f"only {recording.expected_frames} frames; walk round the place and take 60 or more")
    if recording.coding is None:
        return
    bits = recording.bits_per_pixel
    if bits is not None and bits < FINE_CODING:
        yield (
            f"coded with {bits:.2f} bits a pixel, which hides weak plumes; record with the "
            "highest rate, or photos"
        )
    with open_video(recording.path) as container:
        fps = float(container.streams.video[0].average_rate or 0)
    if 0 < fps < SLOW_FPS:
        yield f"{fps:.1f} frames a second; a camera at rest needs {SLOW_FPS:.0f} to see air move"


def describe_telemetry(path: Path) -> str:
    """Where a position was found, and in how many records; else that there is none."""
    for candidate in telemetry_candidates(path):
        try:
            track = read_telemetry(candidate)
        except BadInputError:
            continue
        where = "its own" if candidate == path else candidate.name
        return f"{where}, {int(track.has_position.sum())} positions"
    return "none found; --telemetry names a log"


def _describe_sizes(recording: Recording) -> str:
    sizes = recording.sizes
    own, full, working = (f"{w}x{h} px" for w, h in (sizes.source, sizes.full, sizes.working))
    reduced = own if full == own else f"{own}, reduced to {full}"
    return reduced if working == full else f"{reduced}, for poses to {working}"


def _video_facts(path: Path) -> Iterator[Fact]:
    with open_video(path) as container:
        stream = container.streams.video[0]
        rate = float(stream.average_rate or 0)
        yield "rate", f"{rate:.2f} frames a second" if rate else "not stated"
        codec = stream.codec_context
        samples = codec.pix_fmt or "unknown samples"
        yield "codec", f"{codec.name}, {samples}, in {container.format.name}"
