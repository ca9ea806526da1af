"""What of this program and its libraries is installed."""

import platform
import re
from dataclasses import dataclass
from importlib import metadata

from geometry.processes import count_cores
from locate import __version__

DISTRIBUTION = "plume-locate"
_REQUIREMENT = re.compile(r"""(?P<name>[\w.-]+)[^;]*(?:;.*extra == ["'](?P<extra>[\w-]+)["'])?""")
FOR_DEVELOPERS = "dev"


@dataclass(frozen=True, kw_only=True)
class Extra:
    """One of the extras that `pip install 'plume-locate[NAME]'` adds.

    Attributes:
        name: Of the extra.
        missing: Its libraries that are not there; empty where it is installed.
    """

    name: str
    missing: tuple[str, ...]


def list_extras() -> list[Extra]:
    """Every extra; empty where this program runs from its source without being installed."""
    try:
        required = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        return []
    libraries: dict[str, list[str]] = {}
    for requirement in required:
        found = _REQUIREMENT.match(requirement)
        if found and found["extra"] and found["extra"] != FOR_DEVELOPERS:
            libraries.setdefault(found["extra"], []).append(found["name"])
    return [
        Extra(name=name, missing=tuple(one for one in needed if version_of(one) is None))
        for name, needed in libraries.items()
    ]


def version_of(distribution: str) -> str | None:
    """Which version of a library is installed, None where it is not."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def describe_machine() -> str:
    """This program, Python and the machine in one line."""
    return (
        f"locate {__version__}, Python {platform.python_version()}, {platform.system()} "
        f"{platform.machine()}, processor cores: {count_cores()}"
    )
