"""`locate adapt`."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from locate.commands.console import Weights, err, out
from locate.journal.progress import progress_bars

MOST_FRAMES = 40
"""Used of a recording; chosen."""


def adapt(
    source: Annotated[
        Path, typer.Argument(help="A run folder, an image, a folder of photos or a video.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The .onnx file to write.")],
    minutes: Annotated[
        float, typer.Option(min=0.01, max=1e4, help="Of one processor thread, about.")
    ] = 2.0,
    weights: Weights = None,
) -> None:
    """Teach the single-frame detector a background, from frames of it without a plume."""
    from detect.kinds import DYBS
    from geometry.errors import BadInputError
    from locate.pipeline.files import RunFiles
    from locate.recording.frame_files import FrameFiles
    from locate.recording.opening import ANY_SIDE, open_recording

    start = DYBS.find_weights(weights)
    if start is None:
        raise BadInputError("no weights to begin with; give some with --weights FILE.onnx")
    if output.suffix != ".onnx" or not output.parent.is_dir():
        raise BadInputError(f"{output}: give the name of an .onnx file in a folder that is there")
    try:
        import onnx  # noqa: F401
        import torch  # noqa: F401
    except ModuleNotFoundError as error:
        raise BadInputError(
            f"{error.name} is missing; pip install 'plume-locate[train]'"
        ) from error
    from detect.learning.background_adaptation import adapt as teach

    frames = RunFiles(source).frames
    recording = open_recording(frames if frames.is_dir() else source, max_side=ANY_SIDE)
    every = max(1, -(-recording.expected_frames // MOST_FRAMES))
    with progress_bars(err) as report, TemporaryDirectory() as workshop:
        images = FrameFiles.of(recording, Path(workshop), every=every).frames().images
        answer = teach(start, images, output, minutes=minutes, report=report)
    where = f"{answer.held_out} held-out images" if answer.held_out else "the same image"
    out.print(f"Learned from {answer.learned}; on {where}, other plumes:", soft_wrap=True)
    for name, score in (("before", answer.before), ("after", answer.after)):
        out.print(
            f"  {name:6}  AUROC {score.auroc:.3f}, r {score.correlation:.2f}, error "
            f"{score.error_px:.3f} px where zero is {score.zero_error_px:.3f} px wrong",
            soft_wrap=True,
        )
    if answer.reliable_classes:
        out.print(f"It has evidence in texture that is: {', '.join(answer.reliable_classes)}")
    elif answer.held_out:
        out.print("It has no evidence: what this background shows is too little.")
    else:
        out.print("It has no evidence: that takes two images or more of the background.")
    out.print(f"Use it: locate detect ... --weights {output}", soft_wrap=True)
