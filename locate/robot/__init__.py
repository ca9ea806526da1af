"""The robot plugin: plumes found live, from images and poses as they come."""

from locate.robot.intake import Counts
from locate.robot.locator import Locator
from locate.robot.next_view import Suggestion
from locate.robot.settings import Settings
from locate.robot.tracks import State, Update

__all__ = ["Counts", "Locator", "Settings", "State", "Suggestion", "Update"]
