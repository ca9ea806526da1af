import importlib.util
import sys
from dataclasses import fields
from pathlib import Path

import pytest
from typer.testing import CliRunner

from geometry.errors import BadInputError
from locate.commands.robot import robot
from locate.robot.parameters import PARAMETERS
from locate.robot.settings import LocatorSettings


def test_node_without_ros_says_what_to_do() -> None:
    if importlib.util.find_spec("rclpy"):
        pytest.skip("there is a ROS 2 here; test_ros2.py runs the node")
    result = CliRunner().invoke(robot, ["ros2", "--ros-args", "-r", "image:=/camera"])
    assert isinstance(result.exception, BadInputError)
    assert "setup.bash" in str(result.exception)


def test_bag_that_is_missing_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
    path = tmp_path / "missing.mcap"
    result = CliRunner().invoke(robot, ["bag", str(path), "-o", str(tmp_path / "out")])
    assert isinstance(result.exception, BadInputError)
    assert "missing.mcap" in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_dds_without_its_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    result = CliRunner().invoke(robot, ["dds"])
    assert isinstance(result.exception, BadInputError)
    assert "plume-locate[dds]" in str(result.exception)


def test_pose_without_its_topic_is_refused() -> None:
    result = CliRunner().invoke(robot, ["dds", "--pose"])
    assert isinstance(result.exception, BadInputError)
    assert "--pose-topic" in str(result.exception)


def test_parameters_of_the_node_keep_their_names() -> None:
    assert {field.name for field in fields(LocatorSettings)} - set(PARAMETERS) == {
        "detector_workers"
    }
    assert PARAMETERS["lookers"][0] == LocatorSettings().detector_workers
    result = CliRunner().invoke(robot, ["dds", "--help"], env={"COLUMNS": "100"})
    assert "--lookers" in result.output
