"""`locate detect`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from locate.commands.console import Output, Weights, err, out
from locate.journal.progress import progress_bars

Name = Literal["dybs", "bos", "registered", "registered-plain"]


def detect(
    source: Annotated[Path, typer.Argument(help="An image, a folder of photos or a video.")],
    output: Output,
    detector: Annotated[
        Name,
        typer.Option(
            help="dybs: each frame alone; bos: against a reference; registered: with --poses."
        ),
    ] = "dybs",
    weights: Weights = None,
    reference: Annotated[
        Path | None,
        typer.Option(help="For bos: an image without plume; else the temporal median."),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="For registered: list of TUM, EuRoC or KITTI, COLMAP model, transforms.json."
        ),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="A JSON file with a camera block as in trajectory.json.")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Measure one of so many frames.")] = 1,
    threshold: Annotated[
        float | None, typer.Option(help="Evidence in nats above which a pixel is in the mask.")
    ] = None,
) -> None:
    """Show what bends light in every frame: displacement, evidence, masks, pictures."""
    from detect.registry import make_detector
    from locate.pipeline.frame_by_frame import MASK_NATS, detect_frames
    from locate.recording.images import read_grey
    from locate.recording.opening import ANY_SIDE, open_recording

    view = None
    if reference is not None:
        view = read_grey(reference, open_recording(source, max_side=ANY_SIDE).stretch)
    method = make_detector(detector, weights=weights, reference=view)
    with progress_bars(err) as report:
        summaries = detect_frames(
            source,
            output,
            method,
            poses=poses,
            camera=camera,
            every=every,
            threshold_nats=MASK_NATS if threshold is None else threshold,
            report=report,
        )
    strongest = max(summaries, key=lambda one: one.largest_px)
    hits = sum(one.mask_share > 0 for one in summaries)
    measured = sum(one.judged_share for one in summaries) / len(summaries)
    out.print(
        f"Evidence in {hits} of {len(summaries)} frames; {detector} measures {measured:.0%} of "
        "pixels."
    )
    if hits:
        out.print(f"Largest displacement: {strongest.largest_px:.2f} px in {strongest.frame}.")
    out.print(f"Pictures: {output / 'pictures'}", soft_wrap=True)
