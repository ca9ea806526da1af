"""The one door to open3d, which on a bare Linux lacks libusb."""

import ctypes
from functools import cache
from importlib import import_module
from types import ModuleType


@cache
def load_open3d() -> ModuleType:
    """Imports open3d, lending it the wheel `libusb-package` where the system has no libusb.

    Returns:
        The module `open3d`.
    """
    try:
        return import_module("open3d")
    except (ImportError, OSError) as error:
        if "libusb" not in str(error):
            raise
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    return import_module("open3d")
