"""Errors raised on purpose: each has an exit code and one line, what, where and what to do."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Self

from geometry.printable import printable

if TYPE_CHECKING:
    from pydantic import ValidationError


LONGEST = 1000
"""Characters of a message; of a longer one, which quotes a file, the middle is left out."""
LONGEST_REASON = 120
"""Characters of what a library says; the rest is rarely of use."""
INTERRUPTED = "interrupted; the same command goes on from here"
KEPT = "what was finished before is kept"


class LocateError(Exception):
    """Base of every error this project raises on purpose; its text is one line for a person."""

    exit_code = 1

    def __str__(self) -> str:
        lines = (line.strip() for line in super().__str__().splitlines())
        text = printable(" ".join(line for line in lines if line))
        if len(text) <= LONGEST:
            return text
        return f"{text[: LONGEST // 2]} ... {text[-LONGEST // 4 :]}"


class InterruptedRunError(LocateError):
    """Somebody stopped the run; nothing already computed is lost."""

    exit_code = 130


class BadInputError(LocateError):
    """An input that cannot be used: missing, unreadable, or not what it claims to be."""

    exit_code = 2


class UnwritableError(BadInputError):
    """A file that cannot be written; the disk may be full."""

    @classmethod
    def of(cls, path: Path, error: Exception) -> Self:
        """By what the system, or a library, says of it."""
        return cls(f"{path}: cannot be written ({getattr(error, 'strerror', None) or error})")


class RegistrationFailure(Enum):
    """Why frames could not be registered; the value is the name used in files and messages."""

    TOO_FEW_FRAMES = "too few frames"
    STATIC_CAMERA = "static camera"
    PURE_ROTATION = "pure rotation"
    LOW_TEXTURE = "too little texture"
    SPLIT_MODELS = "broke into several models"
    FOCAL_DIVERGED = "focal length ran away"
    SEVERAL_ZOOMS = "several zooms"
    IMPLAUSIBLE_POSES = "implausible poses"


class RegistrationError(LocateError):
    """The frames could not be registered; `failure` names the cause, the text gives the cure."""

    exit_code = 3

    def __init__(self, failure: RegistrationFailure, message: str) -> None:
        super().__init__(f"{failure.value}: {message}")
        self.failure = failure
        self._message = message

    def __reduce__(self) -> "tuple[type[RegistrationError], tuple[RegistrationFailure, str]]":
        return type(self), (self.failure, self._message)


def first_complaint(error: "ValidationError", kind: str = "") -> str:
    """The first error in settings: its place, as names joined by dots, and what is wrong there.

    Args:
        error: Of pydantic.
        kind: Said before the place, such as "setting".
    """
    first = error.errors()[0]
    what = str(first["msg"]).removeprefix("Value error, ")
    place = ".".join(str(part) for part in first["loc"])
    return f"{kind} {place}: {what}".lstrip() if place else what


def short_reason(error: Exception) -> str:
    """What a library says is wrong with a file, on one line of 1 to 120 characters."""
    return " ".join(str(error).split())[:LONGEST_REASON] or type(error).__name__


@contextmanager
def report_as_bad_input(path: Path, what: str, *, missing: str | None = None) -> Iterator[None]:
    """Turns whatever a library raises on a broken file into one line.

    Args:
        path: The file.
        what: It was taken for, in the singular.
        missing: What to do where the library is not installed.

    Raises:
        BadInputError: In place of any other exception.
    """
    try:
        yield
    except LocateError:
        raise
    except ModuleNotFoundError as error:
        raise BadInputError(f"{path}: to read {what}s, {missing or error}") from error
    except Exception as error:  # each library and kind of damage has its own
        raise BadInputError(f"{path}: not a readable {what} ({short_reason(error)})") from error


def describe_error(error: Exception) -> str:
    """What the system says went wrong, and with which file, on one line."""
    if isinstance(error, MemoryError):
        return "too little memory"
    what = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
    where = getattr(error, "filename", None)
    return f"{where}: {what}" if where else str(what)
