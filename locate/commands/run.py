"""`locate run` and `locate demo`."""

from contextlib import AbstractContextManager, nullcontext
from enum import Enum, auto
from logging import INFO, WARNING
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from geometry.errors import BadInputError
from geometry.processes import count_cores
from geometry.reports import Report, ignore_report
from locate.commands.console import WEIGHTS, Output, Quiet, Verbose, err, out
from locate.journal.log import log_to_file
from locate.journal.whole_run import run_bar
from locate.pipeline.config import DetectorName, Lens, RunConfig, read_settings
from locate.pipeline.effort import EFFORTS, Effort

RECORDING = "Recording: locate run film.mp4 -o out --shot 2 --max-frames 60"
CAMERA = "Camera and poses: locate run film.mp4 -o out --focal 1450"
PLACE = "Scale and place: locate run film.mp4 -o out --telemetry flight.srt"
BAG = "Bags: locate run robot.mcap -o out --image-topic /camera/image_raw"
MEASUREMENT = "Measurement: locate run film.mp4 -o out --effort thorough --neighbours 12"
AGAIN = "With another setting: locate run --config out/config.yaml --seed 1 -o again"


if TYPE_CHECKING:
    from locate.map.plume import PlumeMap
    from locate.pipeline.files import RunFiles
    from locate.pipeline.run import Run

Force = Annotated[bool, typer.Option("--force", help="Do every stage again.")]


class Shown(Enum):
    """What a run prints while it works, and after."""

    QUIET = auto()
    USUAL = auto()
    VERBOSE = auto()

    @classmethod
    def of(cls, *, quiet: bool, verbose: bool) -> "Shown":
        """What the options ask for.

        Raises:
            BadInputError: They ask for both.
        """
        if quiet and verbose:
            raise BadInputError("give either -q or -v")
        return cls.QUIET if quiet else cls.VERBOSE if verbose else cls.USUAL


def _usual(setting: str) -> str:
    """What a setting is where nothing is given."""
    return str(RunConfig.model_fields[setting].default)


def _by_effort(setting: str) -> str:
    """What a setting is of each effort."""
    return ", ".join(f"{getattr(amounts, setting)} {name}" for name, amounts in EFFORTS.items())


def run(
    output: Output,
    recording: Annotated[
        Path | None,
        typer.Argument(
            help="A video, a folder of photos, or a bag: .mcap, .db3, .bag.", show_default=False
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(help="Settings as in a run's config.yaml; options given go before it."),
    ] = None,
    max_frames: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="The most frames to use.",
            show_default=_by_effort("max_frames"),
            rich_help_panel=RECORDING,
        ),
    ] = None,
    max_side: Annotated[
        int | None,
        typer.Option(
            min=64,
            help="Frames whose longest side is more px are shrunk to it; for poses to 1280 px.",
            show_default=_by_effort("max_side"),
            rich_help_panel=RECORDING,
        ),
    ] = None,
    shot: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Of a video with cuts: the shot to use; else longest.",
            rich_help_panel=RECORDING,
        ),
    ] = None,
    focal: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=1e7,
            help="Focal length in px of the recording's frames.",
            rich_help_panel=CAMERA,
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            help="A JSON file with a camera block as in trajectory.json.",
            rich_help_panel=CAMERA,
        ),
    ] = None,
    lens: Annotated[
        Lens | None,
        typer.Option(
            help="What is estimated of a lens that is not known.",
            show_default=_usual("lens"),
            rich_help_panel=CAMERA,
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="Known poses: list of TUM, EuRoC or KITTI, COLMAP model, transforms.json.",
            rich_help_panel=CAMERA,
        ),
    ] = None,
    telemetry: Annotated[
        Path | None,
        typer.Option(
            help="GPS beside the recording: SRT, GPX, CSV, autopilot log, photos.",
            rich_help_panel=PLACE,
        ),
    ] = None,
    telemetry_offset: Annotated[
        float | None,
        typer.Option(
            help="Time of the telemetry minus that of the video, s; else estimated.",
            rich_help_panel=PLACE,
        ),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option(
            min=1e-3,
            max=1e6,
            help="Height of the camera above the ground in m; sets the scale.",
            rich_help_panel=PLACE,
        ),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            help="Marker board in the scene, DICTIONARY:SIZE[:COLUMNSxROWS[:GAP]], m.",
            rich_help_panel=PLACE,
        ),
    ] = None,
    distance: Annotated[
        Path | None,
        typer.Option(
            help="A JSON file with the distance of two clicked points, see docs.",
            rich_help_panel=PLACE,
        ),
    ] = None,
    image_topic: Annotated[
        str | None,
        typer.Option(help="Its images, where it has several.", rich_help_panel=BAG),
    ] = None,
    pose_topic: Annotated[
        str | None,
        typer.Option(help="Odometry or a pose; else TF if it is there.", rich_help_panel=BAG),
    ] = None,
    world_frame: Annotated[
        str | None,
        typer.Option(help="Of its TF: the frame of the map, Z up; else map.", rich_help_panel=BAG),
    ] = None,
    detector: Annotated[
        DetectorName | None,
        typer.Option(
            help="How refraction is seen; auto looks at the motion.",
            show_default=_usual("detector"),
            rich_help_panel=MEASUREMENT,
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        typer.Option(help=WEIGHTS, rich_help_panel=MEASUREMENT),
    ] = None,
    effort: Annotated[
        Effort | None,
        typer.Option(
            help="How much is looked at; the time foreseen is said.",
            show_default=_usual("effort"),
            rich_help_panel=MEASUREMENT,
        ),
    ] = None,
    detection_frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="In how many frames refraction is measured; twice takes twice as long.",
            show_default=_by_effort("detection_frames"),
            rich_help_panel=MEASUREMENT,
        ),
    ] = None,
    displacement_frames: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Of how many others the displacement alone is measured, where the answer is "
            "unsure; with --effort thorough always.",
            show_default=_by_effort("displacement_frames"),
            rich_help_panel=MEASUREMENT,
        ),
    ] = None,
    neighbours: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="With how many other frames each frame is compared.",
            show_default=_by_effort("neighbours"),
            rich_help_panel=MEASUREMENT,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Of the random choices.",
            show_default=_usual("seed"),
            rich_help_panel=MEASUREMENT,
        ),
    ] = None,
    overlay: Annotated[
        bool | None,
        typer.Option(
            "--overlay/--no-overlay",
            help="Write overlay.mp4, all frames with what was found; else up to a minute of video.",
            show_default=False,
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes and threads that work side by side; else one a core.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the map as JSON, and nothing else, to stdout.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Turn a recording into a 3D plume map."""
    asked = {
        "recording": recording,
        "detector": detector,
        "weights": weights,
        "poses": poses,
        "camera": camera,
        "focal_px": focal,
        "lens": lens,
        "telemetry": telemetry,
        "telemetry_offset_s": telemetry_offset,
        "camera_height_m": camera_height,
        "board": board,
        "distance": distance,
        "image_topic": image_topic,
        "pose_topic": pose_topic,
        "world_frame": world_frame,
        "shot": shot,
        "max_frames": max_frames,
        "max_side": max_side,
        "effort": effort,
        "detection_frames": detection_frames,
        "displacement_frames": displacement_frames,
        "neighbours": neighbours,
        "seed": seed,
        "overlay": overlay,
    }
    given = {name: value for name, value in asked.items() if value is not None}
    settings = given if config is None else read_settings(config) | given
    if "recording" not in settings:
        raise BadInputError(
            "no recording; name a video, a folder of photos or a bag, or give --config FILE"
        )
    shown = Shown.of(quiet=quiet, verbose=verbose)
    _run(RunConfig.of(settings), output, force=force, shown=shown, as_json=as_json, jobs=jobs)


def demo(
    output: Output = Path("out/demo"),
    force: Force = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Run on the bundled sample: a simulated hot leak on a pipe rack, seen from an orbit."""
    from locate.recording.sample import SAMPLE_VIDEO
    from locate.simulation.sample_strength import describe_sample_strength

    shown = Shown.of(quiet=quiet, verbose=verbose)
    _run(RunConfig(recording=SAMPLE_VIDEO), output, force=force, shown=shown)
    if shown is not Shown.QUIET:
        out.print(f"\n{describe_sample_strength()}", soft_wrap=True)


def _run(
    config: RunConfig,
    output: Path,
    *,
    force: bool,
    shown: Shown,
    as_json: bool = False,
    jobs: int | None = None,
) -> None:
    from locate.pipeline.files import RunFiles

    files = RunFiles(output)
    bar: AbstractContextManager[Report] = (
        run_bar(err) if shown is Shown.USUAL else nullcontext(ignore_report)
    )
    with bar as report:
        from locate.pipeline.run import Run

        job = Run(config, output, force=force, report=report, jobs=jobs or count_cores())
        if shown is not Shown.QUIET and not as_json:
            _print_foreseen(job)
        with log_to_file(
            files.log,
            console=None if shown is Shown.QUIET else err,
            shown=INFO if shown is Shown.VERBOSE else WARNING,
        ):
            plume_map = job.run()
    if as_json:
        typer.echo(files.map.read_text().rstrip())
    elif shown is not Shown.QUIET:
        _print_answer(plume_map, files)


def _print_foreseen(job: "Run") -> None:
    from locate.planning.duration import describe_run

    err.print(describe_run(job.config, job.source.open_frames()), soft_wrap=True)


def _print_answer(plume_map: "PlumeMap", files: "RunFiles") -> None:
    from locate.export.table import advice_lines, map_table

    found = plume_map.plumes or plume_map.bearings
    out.print(map_table(plume_map) if found else plume_map.limit_text())
    for line in advice_lines(plume_map):
        out.print(line)
    for note in plume_map.notes:
        out.print(f"- {note}")
    out.print(f"\nReport: {files.report}", soft_wrap=True)
    out.print(f"Map:    {files.map}", soft_wrap=True)
