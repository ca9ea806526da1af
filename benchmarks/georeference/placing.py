"""Scale, up and place of simulated flights: real structure from motion, drawn fixes.

    python -m benchmarks.georeference placing CAMPAIGN RUNS [--draws 25]

CAMPAIGN is a folder of `locate simulate`, RUNS one of run folders with the flights' names
(`flights/` of a survey). Each reconstruction is placed again with so many receivers. Per flight and
receiver: medians of the errors of scale and up, the share within 0.5 % and 0.5 degrees, and the
mean normalised error squared per degree of freedom of a point in the middle (1 is right, more is
overconfident).
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from geometry.errors import BadInputError
from geometry.similarity import align_points
from geometry.trajectory import Trajectory
from locate.evaluation.truth import SceneTruth
from locate.pipeline.place import place_reconstruction
from locate.pipeline.points import load_points
from locate.recording import KeyFrames
from locate.simulation import Campaign
from locate.simulation.subtitles import GpsReceiver, write_subtitles

RECEIVERS = {
    "0.5 m, wandering over 60 s": GpsReceiver(),
    "0.5 m, white": GpsReceiver(white_m=0.5, wander_m=0.0),
    "0.5 m, no gimbal": GpsReceiver(gimbal_deg=None),
    "2 m, wandering over 10 min": GpsReceiver(white_m=0.5, wander_m=2.0, wander_s=600.0),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("campaign", type=Path)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--draws", type=int, default=25)


def main(options: argparse.Namespace) -> None:
    campaign = Campaign.load(options.campaign / "campaign.yaml")
    print("flight | receiver | scale % | tilt deg | within | NEES/dof | refused")
    for flight in campaign.flights:
        run = options.runs / flight.name
        if (run / "sfm" / "trajectory.json").exists():
            truth = SceneTruth.load(options.campaign / "truth" / flight.name).trajectory
            for name, receiver in RECEIVERS.items():
                errors = [
                    measure_error(campaign, run, truth, receiver, np.random.default_rng([77, draw]))
                    for draw in range(options.draws)
                ]
                print_row(f"{flight.name} ({flight.path.kind}) | {name}", errors)


def print_row(title: str, errors: list[tuple[float, float, float] | None]) -> None:
    known = np.array([error for error in errors if error is not None])
    scale, tilt, _ = np.median(known, axis=0)
    within = np.mean((known[:, 0] < 0.5) & (known[:, 1] < 0.5))
    refused = len(errors) - len(known)
    print(
        f"{title} | {scale:.2f} | {tilt:.2f} | {within:.0%} | {known[:, 2].mean():.2f} | {refused}",
        flush=True,
    )


def measure_error(
    campaign: Campaign,
    run: Path,
    truth: Trajectory,
    receiver: GpsReceiver,
    rng: np.random.Generator,
) -> tuple[float, float, float] | None:
    """Errors of scale (%) and up (degrees), and NEES/dof of a point; None where refused."""
    scene = Trajectory.load(run / "sfm" / "trajectory.json")
    earth = campaign.origin.build()
    with tempfile.TemporaryDirectory() as workshop:
        path = Path(workshop) / "fixes.srt"
        write_subtitles(path, truth, earth, receiver, start=campaign.flights[0].start, rng=rng)
        try:
            placement = place_reconstruction(
                scene,
                KeyFrames.load(run / "frames" / "index.json"),
                [path],
                asked=True,
                points_in_world=load_points(run / "sfm" / "points.npz"),
            )
        except BadInputError:
            return None
    assert placement.alignment is not None
    assert placement.georeference is not None
    moved = placement.apply(scene)
    true_in_enu = placement.georeference.to_enu(
        earth.lat_lon_height(truth.centers_in_world[scene.indices])
    )
    off = align_points(moved.centers_in_world, true_in_enu)
    middle = placement.georeference.to_enu(earth.lat_lon_height([0.0, 24.0, 5.0]))
    in_map = off.inverse()(middle)
    miss = (in_map - middle)[0]
    covariance = placement.alignment.position_covariances(in_map)[0]
    return (
        abs(np.log(off.scale)) * 100,
        float(np.degrees(np.arccos(np.clip(off.rotation[2, 2], -1, 1)))),
        float(miss @ np.linalg.solve(covariance, miss) / 3),
    )
