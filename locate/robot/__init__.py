"""The robot plugin: plumes found live, from images and poses as they come."""

from locate.robot.keyframe_selector import Counts
from locate.robot.locator import Locator
from locate.robot.next_view import Suggestion
from locate.robot.plume_tracks import State, Update
from locate.robot.settings import Settings

__all__ = ["Counts", "Locator", "Settings", "State", "Suggestion", "Update"]
