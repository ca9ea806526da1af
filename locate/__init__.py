"""3D maps of plumes and leaks from a video by a moving camera.

What a program needs is here, and is imported when it is first used::

    import locate

    plume_map = locate.run("video.mp4", "out")
    for plume in plume_map.plumes:
        print(plume.source, plume.source_covariance, plume.probability)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import geometry  # noqa: F401 - it limits OpenCV, which must come later

if TYPE_CHECKING:
    from geometry.errors import LocateError
    from locate.evaluation.api import evaluate
    from locate.map.answer import Answer, Obstacle
    from locate.map.plume import Bearing, Plume, PlumeMap
    from locate.pipeline.api import load_map, run
    from locate.pipeline.config import RunConfig
    from locate.robot.locator import Locator

__version__ = "0.2.0"

__all__ = [
    "Answer",
    "Bearing",
    "LocateError",
    "Locator",
    "Obstacle",
    "Plume",
    "PlumeMap",
    "RunConfig",
    "evaluate",
    "load_map",
    "run",
]

_MODULES = {
    "Answer": "locate.map.answer",
    "Bearing": "locate.map.plume",
    "LocateError": "geometry.errors",
    "Locator": "locate.robot.locator",
    "Obstacle": "locate.map.answer",
    "Plume": "locate.map.plume",
    "PlumeMap": "locate.map.plume",
    "RunConfig": "locate.pipeline.config",
    "evaluate": "locate.evaluation.api",
    "load_map": "locate.pipeline.api",
    "run": "locate.pipeline.api",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
