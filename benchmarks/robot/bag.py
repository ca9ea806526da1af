"""What a robot's recording costs: the offline run, and playing it into the locator.

    python -m benchmarks.robot bag

The bundled recording is written as an .mcap with its camera_info and its true poses, said to be
known to 5 mm and 0.05 degrees, and given to `locate run` and to `locate robot bag`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from benchmarks.common.cost import children_cpu_s, children_peak_mib
from geometry.trajectory import Trajectory
from locate.map.plume import PlumeMap
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO

NS = 1_000_000_000
VARIANCES = np.repeat([0.005, np.deg2rad(0.05)], 3) ** 2
TYPES = get_typestore(Stores.LATEST)


def made(kind: str, **fields: Any) -> Any:
    return TYPES.types[kind](**fields)


def header(time_s: float, frame_id: str) -> Any:
    stamp_ns = round((100 + time_s) * NS)
    stamp = made("builtin_interfaces/msg/Time", sec=stamp_ns // NS, nanosec=stamp_ns % NS)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def pose(truth: Trajectory, row: int, time_s: float) -> Any:
    x, y, z, w = Rotation.from_matrix(truth.rotations[row].T).as_quat()
    position = dict(zip("xyz", truth.centers_in_world[row], strict=True))
    geometry = made(
        "geometry_msgs/msg/Pose",
        position=made("geometry_msgs/msg/Point", **position),
        orientation=made("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )
    known = made(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=geometry,
        covariance=np.diag(VARIANCES).ravel(),
    )
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    return made(kind, header=header(time_s, "map"), pose=known)


def info(truth: Trajectory) -> Any:
    places = ("x_offset", "y_offset", "height", "width")
    region = made("sensor_msgs/msg/RegionOfInterest", do_rectify=False, **dict.fromkeys(places, 0))
    return made(
        "sensor_msgs/msg/CameraInfo",
        header=header(0.0, "camera"),
        height=truth.camera.height,
        width=truth.camera.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=truth.camera.matrix.ravel(),
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def messages(truth: Trajectory) -> Iterator[tuple[str, float, Any]]:
    yield "/camera/camera_info", 0.0, info(truth)
    for row, frame in enumerate(open_recording(SAMPLE_VIDEO, max_side=ANY_SIDE).frames()):
        height, width = frame.image.shape
        yield "/pose", frame.time_s, pose(truth, row, frame.time_s)
        image = made(
            "sensor_msgs/msg/Image",
            header=header(frame.time_s, "camera"),
            height=height,
            width=width,
            encoding="mono8",
            is_bigendian=0,
            step=width,
            data=frame.image.ravel(),
        )
        yield "/camera/image_raw", frame.time_s, image


def record(folder: Path, truth: Trajectory) -> None:
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for topic, time_s, message in messages(truth):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            content = TYPES.serialize_cdr(message, kind)
            writer.write(connections[topic], round((100 + time_s) * NS), content)


def timed(command: list[str | Path]) -> str:
    before_s, started_s = children_cpu_s(), time.monotonic()
    subprocess.run([sys.executable, "-m", "locate", *command], check=True, capture_output=True)
    wall_s, spent_s = time.monotonic() - started_s, children_cpu_s() - before_s
    return f"{spent_s:.0f} CPU s, {wall_s:.0f} s in all, at most {children_peak_mib():.0f} MB"


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """There are none."""


def main(_options: argparse.Namespace) -> None:
    truth = Trajectory.from_dict(json.loads((SAMPLE / "truth.json").read_text()))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record(folder / "drive", truth)
        bag = folder / "drive" / "drive.mcap"
        for way in (["run"], ["robot", "bag"]):
            output = folder / way[0]
            print(f"locate {' '.join(way)}: {timed([*way, bag, '-o', output])}", flush=True)
            for plume in PlumeMap.load(output / "map.json").plumes:
                sigma = plume.principal_sigmas[0]
                print(f"  source {plume.source.round(2)}, sigma {sigma:.2f} m")
