"""The stamp of a finished stage."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from geometry.atomic import write_text_atomic
from geometry.removal import is_plain_name
from locate.journal.costs import StageTime
from locate.pipeline.files import RunFiles

OWN_FILES = (RunFiles(Path()).config.name, RunFiles(Path()).log.name)
"""Files of the run itself; no stage makes them."""


def check_output_name(name: str) -> str:
    """Refuses what is not the name of a file or folder directly below the run folder."""
    if not is_plain_name(name) or name.startswith(".") or name in OWN_FILES:
        raise ValueError(f"{name!r} is not the name of a stage's file")
    return name


class Stamp(BaseModel):
    """What is remembered of a finished stage.

    Attributes:
        fingerprint: Of all that its result depends on.
        outputs: Names of what it left, each directly below the run folder.
        time: What it cost.
    """

    model_config = ConfigDict(strict=True, frozen=True)

    fingerprint: str
    outputs: list[Annotated[str, AfterValidator(check_output_name)]]
    time: StageTime

    def save(self, path: Path) -> None:
        """Writes the stamp, whole or not at all."""
        write_text_atomic(path, self.model_dump_json(indent=1))

    @classmethod
    def load(cls, path: Path) -> Self | None:
        """Reads what `save` wrote; None where there is no stamp, or none that can be trusted."""
        try:
            return cls.model_validate_json(path.read_bytes())
        except (OSError, ValidationError):
            return None
