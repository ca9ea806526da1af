"""`locate bos`."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from geometry.lock import hold_output
from geometry.named_paths import resolve_path
from geometry.reports import Report
from locate.commands.console import Output, err, out
from locate.journal.progress import progress_bars

if TYPE_CHECKING:
    from detect.recordings import RecordedPairs
    from geometry.stretch import Stretch
    from locate.recording import Recording

SplitName = Literal["train", "validation", "test"]


def bos(
    recordings: Annotated[
        list[Path], typer.Argument(help="Videos, or folders of frames, by a camera at rest.")
    ],
    output: Output,
    reference: Annotated[
        str, typer.Option(help="The view without plume: first:N frames, or an image file.")
    ] = "first:50",
    flow: Annotated[
        str, typer.Option(help="How the flow is measured: a method's name or an .onnx network.")
    ] = "horn-schunck",
    size: Annotated[int, typer.Option(min=32, help="Side of the crops in px.")] = 480,
    every: Annotated[int, typer.Option(min=1, help="Use one frame of so many.")] = 1,
    split: Annotated[
        SplitName | None,
        typer.Option(help="train, validation or test; without it the recording's name decides."),
    ] = None,
) -> None:
    """Turn recordings of plumes before a known background into (frame, flow) training data."""
    from detect.flow import flow_method
    from detect.recordings import PairSettings, record_pairs
    from locate.recording.opening import ANY_SIDE, open_recording

    settings = PairSettings(flow=flow, size_px=size, every=every, split=split)
    parse_reference(reference)
    flow_method(flow)  # an unknown one is named before the folder is made
    refused = 0
    opened = [open_recording(path, max_side=ANY_SIDE) for path in recordings]
    with hold_output(output):
        for path, recording in zip(recordings, opened, strict=True):
            known = parse_reference(reference, recording.stretch)
            named = resolve_path(path)
            name = named.stem if recording.is_video else named.name
            with progress_bars(err) as report:
                pairs = record_pairs(
                    name, _grey_frames(recording, name, report), known, output, settings
                )
            refused += pairs.fault is not None
            out.print(describe_pairs(pairs))
    if refused:
        raise BadInputError(
            f"{refused} of {len(recordings)} recordings refused, see {output / 'recordings'}"
        )


def parse_reference(text: str, stretch: "Stretch | None" = None) -> GreyImage | int:
    """A number of frames from first:N, or the image in that file.

    Args:
        text: As given.
        stretch: Of the recording, for an image of 16 bits.

    Raises:
        BadInputError: Neither.
    """
    kind, colon, count = text.partition(":")
    if kind == "first" and colon:
        if not re.fullmatch(r"0*[1-9]\d{0,8}", count, re.ASCII):
            raise BadInputError(f"--reference {text}: expected first:N with N of 1 or more")
        return int(count)
    from locate.recording.images import read_grey

    return read_grey(Path(text), stretch)


def describe_pairs(pairs: "RecordedPairs") -> str:
    """One line on what became of a recording."""
    if pairs.fault:
        return f"{pairs.name}: refused, {pairs.fault.value}"
    peaks = [frame.peak_px for frame in pairs.kept]
    return (
        f"{pairs.name}: {len(pairs.kept)} of {len(pairs.frames)} frames, {pairs.crops} crops "
        f"for {pairs.split}, peaks {min(peaks):.2f} to {max(peaks):.2f} px"
    )


def _grey_frames(recording: "Recording", name: str, report: Report) -> Iterator[GreyImage]:
    total = max(1, recording.expected_frames)
    for frame in recording.frames():
        report(name, min(1.0, frame.index / total))
        yield frame.image
    report(name, 1.0)
