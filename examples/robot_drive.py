"""A robot drives past a leaking pipe rack and says, while it drives, where the leak is.

    python examples/robot_drive.py                # as fast as it goes: about two minutes
    python examples/robot_drive.py --realtime     # as it would be: frames are dropped

The robot is simulated: the bundled recording is its camera, the recording's true poses, spoilt by a
drift, are its odometry. `Locator` is what a robot's own program would feed.
"""

import argparse
import json
import time
from collections.abc import Iterator

import numpy as np
from rich.console import Console

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.robot import Locator, PlumeUpdate

DRIFT_PER_ROOT_METRE = 0.005
SIGMA_RAD, SIGMA_M = np.deg2rad(0.05), 0.003
NS = 1_000_000_000


def odometry(
    truth: Trajectory, rng: np.random.Generator
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """world_from_cam and its covariance, frame by frame: right at first, then drifting."""
    centers = truth.centers_in_world
    steps_m = np.linalg.norm(np.diff(centers, axis=0, prepend=centers[:1]), axis=1)
    sigmas_m = DRIFT_PER_ROOT_METRE * np.sqrt(steps_m)
    drift = np.cumsum(rng.normal(size=centers.shape) * sigmas_m[:, None], axis=0)
    variances = SIGMA_M**2 + np.cumsum(sigmas_m**2)
    for i, variance in enumerate(variances):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = truth.rotations[i].T, centers[i] + drift[i]
        yield pose, np.diag([*[SIGMA_RAD**2] * 3, *[variance] * 3])


def line(update: PlumeUpdate) -> str:
    plume = update.plume
    place = ", ".join(f"{value:.2f}" for value in plume.source)
    sigma = f"sigma {plume.principal_sigmas[0]:.2f} m"
    return f"{update.state} {plume.id}: ({place}) m, {sigma}, P {plume.probability:.3f}"


def main(*, realtime: bool = False) -> list[PlumeUpdate]:
    console = Console()
    content = json.loads((SAMPLE / "truth.json").read_text())
    truth = Trajectory.from_dict(content)
    poses = odometry(truth, np.random.default_rng(0))
    updates: list[PlumeUpdate] = []
    with Locator(truth.camera, threaded=realtime) as locator:
        frames = open_recording(SAMPLE_VIDEO, max_side=ANY_SIDE).frames()
        for frame, (pose, covariance) in zip(frames, poses, strict=True):
            stamp_ns = round(frame.time_s * NS)
            latest = locator.feed(frame.image, pose, covariance, stamp_ns)
            for update in latest:
                console.print(f"{frame.time_s:5.1f} s  {line(update)}", highlight=False)
            updates += latest
            if realtime:
                time.sleep(1 / 15)
        for update in locator.finish():
            updates.append(update)
            console.print(f"  end    {line(update)}", highlight=False)
        console.print(locator.counts)
    for plume in content["plumes"]:
        source = ", ".join(f"{value:.2f}" for value in plume["source"])
        console.print(f"truth: ({source}) m", highlight=False)
    return updates


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--realtime", action="store_true")
    main(realtime=parser.parse_args().realtime)
