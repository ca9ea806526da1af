"""Loads open3d, which on a bare Linux lacks libraries of the system."""

import ctypes
import sys
from functools import cache
from importlib import import_module
from types import ModuleType

from geometry.errors import LocateError

CURE = "on Debian or Ubuntu: sudo apt-get install libgl1 libegl1 libx11-6 libudev1 libidn2-0"
"""How to install what open3d lacks on a bare Linux."""
WEB_DRAWING = "open3d.visualization.draw_plotly"
WEB_DRAWING_NAMES = ("draw_plotly", "draw_plotly_server", "get_plotly_fig")
"""What open3d takes from there at its import; None of them in this program."""


@cache
def load_open3d() -> ModuleType:
    """Imports open3d, lending it the libusb of the `libusb-package` wheel where there is none.

    Returns:
        The module `open3d`.

    Raises:
        LocateError: Another library of the system is missing.
    """
    try:
        return _import_open3d()
    except (ImportError, OSError) as error:
        if "libusb" not in str(error):
            raise LocateError(f"open3d does not start: {error}; {CURE}") from error
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    try:
        return _import_open3d()
    except (ImportError, OSError) as error:
        raise LocateError(f"open3d does not start: {error}; {CURE}") from error


def _import_open3d() -> ModuleType:
    """Imports it without its drawing by a web server, whose import opens a socket."""
    stand_in = ModuleType(WEB_DRAWING)
    vars(stand_in).update(dict.fromkeys(WEB_DRAWING_NAMES))
    ours = sys.modules.setdefault(WEB_DRAWING, stand_in) is stand_in
    try:
        return import_module("open3d")
    finally:
        if ours:
            del sys.modules[WEB_DRAWING]
