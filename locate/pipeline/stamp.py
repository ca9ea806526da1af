"""The stamp of a finished stage."""

import hashlib
import stat
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from geometry.atomic import write_text_atomic
from geometry.regular_files import open_regular, read_content
from geometry.removal import is_plain_name
from locate.journal.costs import StageTime
from locate.pipeline.files import RunFiles

OWN_FILES = (RunFiles(Path()).config.name, RunFiles(Path()).log.name)
"""Files of the run itself; no stage makes them."""
PUBLISHING = "publishing"
"""In place of a fingerprint: the stage's files are on their way to their places."""


def check_output_name(name: str) -> str:
    """The name of a file or folder directly in the run folder.

    Raises:
        ValueError: It is no such name.
    """
    if not is_plain_name(name) or name.startswith(".") or name in OWN_FILES:
        raise ValueError(f"{name!r} is not the name of a stage's file")
    return name


def check_output_path(path: str) -> str:
    """The path of a file in the output of a stage.

    Raises:
        ValueError: It is no such path.
    """
    first, *inner = path.split("/")
    check_output_name(first)
    if not all(is_plain_name(name) for name in inner):
        raise ValueError(f"{path!r} is not the path of a stage's file")
    return path


class FileDigest(BaseModel):
    """Size and digest of a file, which change when it is altered.

    Attributes:
        size: Bytes.
        sha256: Hexadecimal, of all of them.
    """

    model_config = ConfigDict(strict=True, frozen=True)

    size: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> Self:
        """Of a file.

        Raises:
            OSError: It cannot be read.
        """
        with open_regular(path) as stream:
            return cls(
                size=path.stat().st_size, sha256=hashlib.file_digest(stream, "sha256").hexdigest()
            )


class Stamp(BaseModel):
    """What is remembered of a finished stage.

    Attributes:
        fingerprint: Of all that its result depends on.
        outputs: Names of what it left, each directly below the run folder.
        files: Every file of these, by its path from the run folder.
        time: What it cost.
    """

    model_config = ConfigDict(strict=True, frozen=True)

    fingerprint: str
    outputs: list[Annotated[str, AfterValidator(check_output_name)]]
    files: dict[Annotated[str, AfterValidator(check_output_path)], FileDigest]
    time: StageTime

    def save(self, path: Path) -> None:
        """Writes the stamp, whole or not at all."""
        write_text_atomic(path, self.model_dump_json(indent=1))

    @classmethod
    def load(cls, path: Path) -> Self | None:
        """Reads what `save` wrote; None where there is no stamp, or none that is whole."""
        try:
            return cls.model_validate_json(read_content(path))
        except (OSError, ValidationError):
            return None

    def find_damage(self, root: Path) -> str | None:
        """The first file that is missing or not as it was left; None where all are."""
        missing = (name for name in self.outputs if not (root / name).exists())
        changed = (name for name, known in self.files.items() if not _is_intact(root, name, known))
        return next(missing, None) or next(changed, None)


def digest_outputs(root: Path) -> dict[str, FileDigest]:
    """Of every file below a folder, by its path from there, in order."""
    return {str(path.relative_to(root)): FileDigest.of(path) for path in _files_below(root)}


def _files_below(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.is_symlink():
            yield from _files_below(path)
        else:
            yield path


def _is_intact(root: Path, name: str, known: FileDigest) -> bool:
    """Whether a file is there, itself and not by a link, with the content it had."""
    path = root / name
    folders = [root / folder for folder in PurePosixPath(name).parents][:-1]
    try:
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or any(folder.is_symlink() for folder in folders):
            return False
        return status.st_size == known.size and FileDigest.of(path) == known
    except OSError:
        return False
