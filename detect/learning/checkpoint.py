"""What a training leaves on disk: checkpoints, written whole or not at all, and a journal."""

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import torch
from torch import nn

from geometry.atomic import atomic_path, write_text_atomic
from geometry.errors import BadInputError, UnwritableError, short_reason
from geometry.json_text import parse_json
from geometry.json_values import as_whole_number
from geometry.regular_files import append_regular, open_regular
from geometry.text_files import read_text

SCHEMA = "locate.training/1"
JOURNAL = "journal.jsonl"
CONTENT = {"digest": str, "step": int, "best": float, "network": dict, "optimiser": dict}
"""What a checkpoint holds, and of which type."""


def write_checkpoint(path: Path, content: Mapping[str, Any]) -> None:
    """Writes tensors and plain values under a temporary name, then renames it.

    Raises:
        UnwritableError: The file cannot be written.
    """
    buffer = BytesIO()  # torch itself does not say why it cannot write
    torch.save({"schema": SCHEMA, **content}, buffer)
    try:
        with atomic_path(path) as unfinished:
            unfinished.write_bytes(buffer.getbuffer())
    except OSError as error:
        raise UnwritableError.of(path, error) from error


def read_checkpoint(path: Path) -> dict[str, Any]:
    """What `write_checkpoint` wrote; nothing in it is run.

    Raises:
        BadInputError: The file is missing, broken, or something else.
    """
    try:
        with open_regular(path) as file:
            content = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # each kind of damage to a pickle has its own
        reason = short_reason(error)
        raise BadInputError(f"{path}: not a readable checkpoint ({reason})") from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise BadInputError(f"{path}: not a checkpoint of schema {SCHEMA}")
    for name, kind in CONTENT.items():
        if not isinstance(content.get(name), kind):
            raise BadInputError(f"{path}: not a whole checkpoint ({name} is missing or wrong)")
    return content


def load_weights(network: nn.Module, content: Mapping[str, Any], path: Path) -> None:
    """Puts a checkpoint's weights into a network.

    Raises:
        BadInputError: It is of another network.
    """
    try:
        network.load_state_dict(content["network"])
    except (AttributeError, RuntimeError, TypeError) as error:
        raise BadInputError(f"{path}: weights of another network than the config's") from error


def append_to_journal(folder: Path, line: Mapping[str, Any]) -> None:
    """Adds a line to the journal of a training.

    Raises:
        UnwritableError: It cannot be added; a part of it may stand there.
    """
    try:
        with append_regular(folder / JOURNAL) as file:
            file.write(json.dumps(line) + "\n")
    except OSError as error:
        raise UnwritableError.of(folder / JOURNAL, error) from error


def read_journal(folder: Path) -> list[dict[str, Any]]:
    """The lines of a training's journal, up to one that is torn."""
    lines = []
    for text in read_text(folder / JOURNAL).splitlines():
        try:
            line = parse_json(text)
            as_whole_number(line["step"], "step")
        except (LookupError, TypeError, ValueError):
            break
        lines.append(line)
    return lines


def rewind_journal(folder: Path, step: int) -> None:
    """Forgets what was noted after a step: it will be noted again.

    Raises:
        UnwritableError: The journal cannot be written.
    """
    if (folder / JOURNAL).exists():
        kept = [line for line in read_journal(folder) if line["step"] <= step]
        try:
            write_text_atomic(folder / JOURNAL, "".join(json.dumps(line) + "\n" for line in kept))
        except OSError as error:
            raise UnwritableError.of(folder / JOURNAL, error) from error
