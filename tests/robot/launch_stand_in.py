"""Stands in for `launch` of ROS 2, which cannot be installed outside of ROS.

A launch file that is imported with these modules describes what it would start; `started_by` says
what that is for given arguments.
"""

import runpy
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock


@dataclass(frozen=True)
class LaunchConfiguration:
    name: str


@dataclass(frozen=True)
class NotEqualsSubstitution:
    left: Any
    right: Any


@dataclass(frozen=True)
class IfCondition:
    value: Any


@dataclass(frozen=True)
class LaunchDescription:
    entities: list[Any]


class DeclareLaunchArgument:
    def __init__(self, name: str, *, default_value: str, description: str) -> None:
        self.name, self.default_value, self.description = name, default_value, description


class Action:
    """A process: a `Node`, or a command."""

    def __init__(self, **fields: Any) -> None:
        self.fields = fields


MODULES: dict[str, dict[str, Any]] = {
    "launch": {"LaunchDescription": LaunchDescription},
    "launch.actions": {
        "DeclareLaunchArgument": DeclareLaunchArgument,
        "ExecuteProcess": Action,
    },
    "launch.conditions": {"IfCondition": IfCondition},
    "launch.substitutions": {
        "LaunchConfiguration": LaunchConfiguration,
        "NotEqualsSubstitution": NotEqualsSubstitution,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Action},
    "ament_index_python": {},
}


def describe(launch_file: Path) -> list[Any]:
    """What a launch file of the package it lies in describes."""
    modules = {}
    share = {"get_package_share_directory": lambda _: str(launch_file.parents[1])}
    for name, content in {**MODULES, "ament_index_python.packages": share}.items():
        modules[name] = ModuleType(name)
        vars(modules[name]).update(content)
    with mock.patch.dict(sys.modules, modules):
        description = runpy.run_path(str(launch_file))["generate_launch_description"]()
    return list(description.entities)


def arguments_of(entities: list[Any]) -> dict[str, str]:
    """The default of each argument."""
    declared = [one for one in entities if isinstance(one, DeclareLaunchArgument)]
    return {one.name: one.default_value for one in declared}


def started_by(entities: list[Any], **given: str) -> list[dict[str, Any]]:
    """The fields of each process that starts, every argument put in."""
    values = arguments_of(entities)
    assert given.keys() <= values.keys()
    values |= given
    actions = [one.fields for one in entities if isinstance(one, Action)]
    filled = [_fill({"condition": True, **fields}, values) for fields in actions]
    return [fields for fields in filled if fields.pop("condition") in (True, "true")]


def _fill(value: Any, values: Mapping[str, str]) -> Any:
    """A value as `launch` would work it out; a list within a pair is one text."""
    match value:
        case LaunchConfiguration(name):
            return values[name]
        case NotEqualsSubstitution(left, right):
            return "true" if _fill(left, values) != _fill(right, values) else "false"
        case IfCondition(inner):
            return _fill(inner, values)
        case (str(source), list(parts)):
            return source, "".join(_fill(part, values) for part in parts)
        case dict():
            return {key: _fill(inner, values) for key, inner in value.items()}
        case list() | tuple():
            return type(value)(_fill(inner, values) for inner in value)
    return value
