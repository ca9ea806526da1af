"""The command line: a thin skin over the library."""

import errno
import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from geometry.errors import LocateError
from locate import __version__
from locate.config import DetectorName, RunConfig
from locate.journal import interruptible, journal, progress_bars, silent

NO_SPACE = (errno.ENOSPC, errno.EDQUOT)

app = typer.Typer(
    help="3D maps of plumes and leaks from a video by a moving camera.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out = Console()
err = Console(stderr=True)

Output = Annotated[Path, typer.Option("-o", "--output", help="The run folder.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say what each stage does.")]


def _version(asked: bool) -> None:
    if asked:
        out.print(f"locate {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


@app.command()
def run(
    recording: Annotated[Path, typer.Argument(help="A video file or a folder of photos.")],
    output: Output,
    detector: Annotated[
        DetectorName, typer.Option(help="How refraction is seen; auto looks at the motion.")
    ] = "auto",
    poses: Annotated[
        Path | None,
        typer.Option(help="Known poses: TUM, COLMAP model, transforms.json, trajectory.json."),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="A JSON file with a camera block as in trajectory.json.")
    ] = None,
    focal: Annotated[
        float | None, typer.Option(min=1e-6, help="Focal length in px of the recording's frames.")
    ] = None,
    max_frames: Annotated[int, typer.Option(min=2, help="The most frames to use.")] = 120,
    force: Annotated[bool, typer.Option("--force", help="Do every stage again.")] = False,
    verbose: Verbose = False,
) -> None:
    """Turn a recording into a 3D plume map."""
    config = RunConfig(
        recording=recording,
        detector=detector,
        poses=poses,
        camera=camera,
        focal_px=focal,
        max_frames=max_frames,
    )
    _run(config, output, force=force, verbose=verbose)


@app.command()
def demo(
    output: Output = Path("out/demo"),
    force: Annotated[bool, typer.Option("--force", help="Do every stage again.")] = False,
    verbose: Verbose = False,
) -> None:
    """Run on the bundled sample: a simulated hot leak on a pipe rack, seen from an orbit."""
    from locate.sample import SAMPLE_VIDEO

    _run(RunConfig(recording=SAMPLE_VIDEO), output, force=force, verbose=verbose)


def _run(config: RunConfig, output: Path, *, force: bool, verbose: bool) -> None:
    from locate.export.table import map_table
    from locate.pipeline import Run

    with interruptible(), progress_bars(err) as report:
        job = Run(config, output, force=force, report=silent if verbose else report)
        with journal(output / "log.jsonl", console=err if verbose else None):
            plume_map = job.run()
    found = plume_map.plumes or plume_map.bearings
    out.print(map_table(plume_map) if found else plume_map.limit_text())
    for note in plume_map.notes:
        out.print(f"- {note}")
    out.print(f"\nReport: {output / 'report.html'}", soft_wrap=True)
    out.print(f"Map:    {output / 'map.json'}", soft_wrap=True)


@app.command()
def simulate(
    scene: Annotated[Path, typer.Argument(help="A scene file, see examples/scenes.")],
    output: Output,
    onto: Annotated[
        Path | None,
        typer.Option(help="Render the plume onto this posed photo set instead of a made scene."),
    ] = None,
) -> None:
    """Render a video of a scene with plumes, with its ground truth."""
    from locate.simulation import Scene, render_onto
    from locate.simulation import simulate as render

    loaded = Scene.load(scene)
    with progress_bars(err) as report:

        def progress(done: int, total: int) -> None:
            report("rendering", done / total)

        if onto is None:
            render(loaded, output, progress=progress)
        else:
            render_onto(loaded, onto, output, progress=progress)
    out.print(f"Truth: {output / 'truth.json'}", soft_wrap=True)


@app.command()
def evaluate(
    output: Annotated[Path, typer.Argument(help="A run folder.")],
    truth: Annotated[Path, typer.Option(help="The folder that `locate simulate` wrote.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Hold a map against the truth of a simulated scene."""
    from geometry.trajectory import Trajectory
    from locate.evaluate import evaluate as compare
    from locate.evaluate.table import evaluation_table
    from locate.plume import PlumeMap

    path = output / "trajectory.json"
    evaluation = compare(
        PlumeMap.load(output / "map.json"),
        Trajectory.load(path) if path.exists() else None,
        truth,
        output / "detections",
    )
    if as_json:
        typer.echo(json.dumps(evaluation.to_dict(), indent=1))
    else:
        out.print(evaluation_table(evaluation))


def main() -> None:
    """Runs the command; every expected failure becomes one line and an exit code."""
    try:
        app()
    except LocateError as error:
        _fail(str(error), error.exit_code)
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        _fail(f"{error.filename or 'disk'}: no space left; free some and run again", 2)


def _fail(message: str, code: int) -> None:
    err.print(f"locate: {message}", style="bold red", soft_wrap=True, markup=False, highlight=False)
    sys.exit(code)
