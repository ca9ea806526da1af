"""`locate run` and `locate demo`."""

from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import Output, Verbose, Weights, err, out
from locate.journal.log import log_to_file
from locate.journal.progress import progress_bars, silent
from locate.pipeline.config import DetectorName, RunConfig


def run(
    recording: Annotated[
        Path, typer.Argument(help="A video, a folder of photos, or a bag: .mcap, .db3, .bag.")
    ],
    output: Output,
    detector: Annotated[
        DetectorName, typer.Option(help="How refraction is seen; auto looks at the motion.")
    ] = "auto",
    weights: Weights = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="Known poses: list of TUM, EuRoC or KITTI, COLMAP model, transforms.json."
        ),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="A JSON file with a camera block as in trajectory.json.")
    ] = None,
    focal: Annotated[
        float | None, typer.Option(min=1e-6, help="Focal length in px of the recording's frames.")
    ] = None,
    telemetry: Annotated[
        Path | None,
        typer.Option(help="GPS beside the recording: SRT, GPX, CSV, autopilot log, photos."),
    ] = None,
    telemetry_offset: Annotated[
        float | None,
        typer.Option(help="Time of the telemetry minus that of the video, s; else estimated."),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option(min=1e-3, help="Height of the camera above the ground in m; sets the scale."),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(help="Marker board in the scene, DICTIONARY:SIZE[:COLUMNSxROWS[:GAP]], m."),
    ] = None,
    distance: Annotated[
        Path | None,
        typer.Option(help="A JSON file with the distance of two clicked points, see docs."),
    ] = None,
    image_topic: Annotated[
        str | None, typer.Option(help="Of a bag: its images, where it has several.")
    ] = None,
    pose_topic: Annotated[
        str | None, typer.Option(help="Of a bag: odometry or a pose; else TF if it is there.")
    ] = None,
    world_frame: Annotated[
        str | None, typer.Option(help="Of a bag's TF: the frame of the map, Z up; else map.")
    ] = None,
    shot: Annotated[
        int | None, typer.Option(min=1, help="Of a video with cuts: the shot to use; else longest.")
    ] = None,
    max_frames: Annotated[int, typer.Option(min=2, help="The most frames to use.")] = 120,
    force: Annotated[bool, typer.Option("--force", help="Do every stage again.")] = False,
    verbose: Verbose = False,
) -> None:
    """Turn a recording into a 3D plume map."""
    config = RunConfig(
        recording=recording,
        detector=detector,
        weights=weights,
        poses=poses,
        camera=camera,
        focal_px=focal,
        telemetry=telemetry,
        telemetry_offset_s=telemetry_offset,
        camera_height_m=camera_height,
        board=board,
        distance=distance,
        image_topic=image_topic,
        pose_topic=pose_topic,
        world_frame=world_frame,
        shot=shot,
        max_frames=max_frames,
    )
    _run(config, output, force=force, verbose=verbose)


def demo(
    output: Output = Path("out/demo"),
    force: Annotated[bool, typer.Option("--force", help="Do every stage again.")] = False,
    verbose: Verbose = False,
) -> None:
    """Run on the bundled sample: a simulated hot leak on a pipe rack, seen from an orbit."""
    from locate.recording.sample import SAMPLE_VIDEO

    _run(RunConfig(recording=SAMPLE_VIDEO), output, force=force, verbose=verbose)


def _run(config: RunConfig, output: Path, *, force: bool, verbose: bool) -> None:
    from locate.export.table import map_table
    from locate.pipeline.files import RunFiles
    from locate.pipeline.run import Run

    files = RunFiles(output)
    with progress_bars(err) as report:
        job = Run(config, output, force=force, report=silent if verbose else report)
        with log_to_file(files.log, console=err if verbose else None):
            plume_map = job.run()
    found = plume_map.plumes or plume_map.bearings
    out.print(map_table(plume_map) if found else plume_map.limit_text())
    for note in plume_map.notes:
        out.print(f"- {note}")
    out.print(f"\nReport: {files.report}", soft_wrap=True)
    out.print(f"Map:    {files.map}", soft_wrap=True)
