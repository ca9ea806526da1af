"""The one door to open3d, which on a bare Linux lacks libraries of the system."""

import ctypes
from functools import cache
from importlib import import_module
from types import ModuleType

from geometry.errors import LocateError

CURE = "on Debian or Ubuntu: sudo apt-get install libgl1 libegl1 libx11-6 libudev1 libidn2-0"
"""How to install what open3d lacks on a bare Linux."""


@cache
def load_open3d() -> ModuleType:
    """Imports open3d, lending it the libusb of the `libusb-package` wheel where there is none.

    Returns:
        The module `open3d`.

    Raises:
        LocateError: Another library of the system is missing.
    """
    try:
        return import_module("open3d")
    except (ImportError, OSError) as error:
        if "libusb" not in str(error):
            raise LocateError(f"open3d does not start: {error}; {CURE}") from error
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    try:
        return import_module("open3d")
    except (ImportError, OSError) as error:
        raise LocateError(f"open3d does not start: {error}; {CURE}") from error
