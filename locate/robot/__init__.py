"""The robot plugin: plumes found live, from images and poses as they come."""

from locate.robot.keyframe_selector import LocatorCounts
from locate.robot.locator import Locator
from locate.robot.next_view import ViewSuggestion
from locate.robot.plume_tracks import PlumeUpdate, TrackState
from locate.robot.settings import LocatorSettings

__all__ = [
    "Locator",
    "LocatorCounts",
    "LocatorSettings",
    "PlumeUpdate",
    "TrackState",
    "ViewSuggestion",
]
