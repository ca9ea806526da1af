"""What up was taken from where nothing measured it."""

from geometry.errors import BadInputError
from geometry.text_files import read_json
from locate.pipeline.files import RunFiles

UP_SOURCES = {
    "plane": "the plane that most points lie on is taken for level ground",
    "level": "the cameras are taken for held level, as they turned without rolling",
    "camera": "the mean of the cameras' own up is taken, which leans where they look up or down",
}
"""By what `geometry.sfm.gauge.normalising_transform` took up from."""
BETTER_UP = "give --telemetry with GPS or gimbal angles if you have it."


def load_up_source(files: RunFiles) -> str | None:
    """What the reconstruction took up from; None where the poses were given.

    Raises:
        BadInputError: The file is damaged.
    """
    if not files.sfm_report.exists():
        return None
    try:
        source = read_json(files.sfm_report)["report"]["up_from"]
        if source not in UP_SOURCES:
            raise ValueError(f"up_from is {source!r}")
    except (LookupError, TypeError, ValueError) as error:
        raise BadInputError(f"{files.sfm_report}: damaged ({error}); delete it") from error
    return str(source)


def guessed_up_note(source: str | None) -> str:
    """From what up was guessed, and what says it better.

    Args:
        source: A key of `UP_SOURCES`; None for given poses that do not say where up is.
    """
    if source is None:
        return (
            f"Up is the z axis of the given poses, which do not say that it points up; {BETTER_UP}"
        )
    return f"Up is a guess: {UP_SOURCES[source]}; {BETTER_UP}"
