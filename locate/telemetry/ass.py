r"""Subtitles of Autel's drones beside their videos, .ass (Advanced SubStation Alpha).

A line ``Dialogue:`` has the fields that the line ``Format:`` of its section names, the text last.
In it ``\N`` is the end of a line, and braces hold how it is drawn. What the text says is read as
in .SRT, see `dji_srt`.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from geometry.errors import BadInputError
from locate.telemetry.dji_srt import track_of_cues
from locate.telemetry.track import TelemetryTrack

KIND = "ASS subtitles"
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d{1,3})?)")
_USUAL_FORMAT = "Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text"
_DRAWING = re.compile(r"\{[^{}]{0,200}\}")


def looks_like_ass(head: str) -> bool:
    """Whether a text begins like such subtitles."""
    return head.lstrip("\ufeff \r\n").startswith("[Script Info]")


def parse_ass(text: str, path: Path) -> TelemetryTrack:
    """Reads the text of an .ass file; times are the starts of the subtitles.

    Raises:
        BadInputError: A line of no known form, or no subtitle holds a position of a known form.
    """
    cues = list(_cues(text, path))
    lines = [line for line, _, _ in cues]
    return track_of_cues(((time_s, body) for _, time_s, body in cues), path, KIND, lines)


def _cues(text: str, path: Path) -> Iterator[tuple[int, float, str]]:
    """Line, time and text of each subtitle."""
    fields = _field_names(_USUAL_FORMAT)
    in_events = False
    for number, line in enumerate(text.splitlines(), start=1):
        kind, _, content = line.partition(":")
        if line.startswith("["):
            in_events = line.strip().lower() == "[events]"
        elif in_events and kind == "Format":
            fields = _field_names(content)
        elif in_events and kind == "Dialogue":
            values = dict(zip(fields, content.split(",", len(fields) - 1), strict=False))
            start = _CLOCK.fullmatch(values.get("start", "").strip())
            if start is None or "text" not in values:
                raise BadInputError(f"{path}, line {number}: no subtitle with a start and a text")
            hours, minutes, seconds = start.groups()
            body = _DRAWING.sub("", values["text"])
            for end in ("\\N", "\\n"):
                body = body.replace(end, " ")
            yield number, int(hours) * 3600 + int(minutes) * 60 + float(seconds), body


def _field_names(listed: str) -> list[str]:
    return [name.strip().lower() for name in listed.split(",")]
