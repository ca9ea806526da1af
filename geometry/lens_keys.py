"""Keys of a camera file that describe its lens.

One that is not read is refused by name unless it is zero: a lens that is left out bends every ray.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from geometry.errors import BadInputError

_LENS_KEY = re.compile(
    r"[kpsb]_?\d+(_?[kp]_?\d+)*|s[xy]\d+|tau_?[xy12]?|omega|xi|alpha|beta|lambda|skew|[dk]|a\d|"
    r"kappa\w*|(radial|tangential|decentering|prism|division|poly|coef)\w*|"
    r"([xy]_)?fov(_?[xy])?|c[xy]\d|(c|f|fl)_?[xy]\w*|cent(er|re)_[xy]|(pixel|sample)_aspect\w*|"
    r"(is_)?(ortho\w*|latlong|equirect\w*|spherical|panoram\w*|omni\w*)|"
    r"camera_(type|params|matrix|k)|(rolling_)?shutter\w*|"
    r".*(dist(ortion)?_?(coef|param|model)|distortion|ftheta|fisheye|lens|intrinsic|principal"
    r"|projection).*",
    re.IGNORECASE,
)
"""Keys that say something of a lens, whether they are read or not."""
_NO_LENS = ("", "none", "false", "0", "0.0", "perspective", "pinhole")
"""Texts that say that there is nothing to read."""


def is_lens_key(key: str) -> bool:
    """True for a key of distortion, projection or shutter."""
    return _LENS_KEY.fullmatch(key) is not None


def is_nothing(value: Any) -> bool:
    """True for zero, no, null, and lists of them."""
    if isinstance(value, (list, tuple)):
        return all(is_nothing(item) for item in value)
    if isinstance(value, dict):
        return all(is_nothing(item) for item in value.values())
    if isinstance(value, str):
        return value.strip().lower() in _NO_LENS
    return value is None or value == 0


def refuse_unread_terms(block: Mapping[str, Any], known: Iterable[str], reader: str) -> None:
    """Refuses what a block says of a lens beyond what is read of it.

    Args:
        block: Keys and values.
        known: Keys that are read.
        reader: What reads it, for the message.

    Raises:
        BadInputError: A key that describes a lens is not known and not zero; named.
    """
    read = set(known)
    for key, value in block.items():
        if key not in read and is_lens_key(key) and not is_nothing(value):
            raise BadInputError(
                f"{key} = {value!r} is not understood with {reader}; name a model that has it, "
                "or remove it if the images are undistorted"
            )
