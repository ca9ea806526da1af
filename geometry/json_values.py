"""Values of JSON files: a truth value or a text is no number, and a number no truth value.

In Python ``true`` is the number 1, and arrays turn "1" into 1 and "false" into true.
"""

import json
from reprlib import repr as short_repr
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from geometry.arrays import FloatArray
from geometry.errors import first_complaint

Checked = TypeVar("Checked")


def as_number(value: Any, name: str) -> float:
    """One number.

    Args:
        value: As JSON holds it.
        name: Of the value, for the message.

    Raises:
        ValueError: It is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name}: {short_repr(value)} is no number")
    return float(value)


def as_numbers(values: Any, name: str) -> FloatArray:
    """An array of lists of numbers at any depth; see `as_number`.

    Raises:
        ValueError: One is no number, or the lists have different lengths.
    """
    pending = [values]
    while pending:
        value = pending.pop()
        if isinstance(value, list | tuple):
            pending.extend(value)
        else:
            as_number(value, name)
    return np.asarray(values, dtype=float)


def as_whole_number(value: Any, name: str) -> int:
    """One number without a fraction; see `as_number`."""
    if as_number(value, name).is_integer():
        return int(value)
    raise ValueError(f"{name}: {short_repr(value)} is no whole number")


def as_truth(value: Any, name: str) -> bool:
    """True or false.

    Raises:
        ValueError: It is neither.
    """
    if isinstance(value, bool):
        return value
    raise ValueError(f"{name}: {short_repr(value)} is neither true nor false")


def check_fields(kind: type[Checked], content: Any) -> Checked:
    """The content of a JSON file as a pydantic model or dataclass, nothing converted.

    Raises:
        ValueError: A field is missing or of another type; named.
    """
    adapter = TypeAdapter(kind)
    # Names of files that are no UTF-8 are lone surrogates, which pydantic takes for no JSON.
    as_json = json.dumps(content, ensure_ascii=False).encode(errors="replace")
    try:
        adapter.validate_json(as_json, strict=True)
        return adapter.validate_python(content)
    except ValidationError as error:
        raise ValueError(first_complaint(error)) from error
