"""Damage to files: cuts and nasty bytes anywhere, or nasty values in a file that stays well-formed.

The number of examples of each reader is `LOCATE_FUZZ_EXAMPLES`; without it they are few and always
the same.
"""

import copy
import json
import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

EXAMPLES = os.environ.get("LOCATE_FUZZ_EXAMPLES")


def fuzzed(usual: int) -> settings:
    """Settings of a test, with its usual number of examples."""
    return settings(
        max_examples=int(EXAMPLES or usual),
        deadline=None,
        derandomize=EXAMPLES is None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


NASTY_BYTES = [
    *(b"nan", b"inf", b"-1e999", b"1e308", b"999", b"-0", b"9" * 400, b"0" * 40, b"1/0"),
    *(b"\n", b"\n\n", b"\r", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b",", b'"', b"\t", b" "),
    *(b"-->", b"GPS(", b")", b"[", b"]", b"<", b">", b"<!ENTITY a 'b'>", b"\xd9\xa3", b"%n"),
    *(b"2023-99-99 25:61:61", b"9999-12-31T23:59:59Z", b"0001-01-01 00:00:00", b"99:99:99,999"),
    *(b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\0", b"\xa3\x95\x80", b"EPSG:4326\n"),
]
Cut = tuple[float, float, bytes]
"""Where it begins (0 to 1), how long it is (bytes over 40), what takes its place."""
NASTY_NUMBERS = [
    0,
    -1,
    0.0,
    -0.0,
    1e-300,
    1e-9,
    0.5,
    1e9,
    1e19,
    1e50,
    1e300,
    2**31,
    2**63,
    -(2**63),
]
NASTY_VALUES = [
    *(*NASTY_NUMBERS, 10**400, float("nan"), float("inf"), -float("inf"), True, None, ""),
    *("nan", "x" * 2000, "\x1b[2J\n", "[bold]", "../../x", "\ud800", "\0", [], {}, [[]], [None]),
    *({"": None}, [1, "a"], [0.0] * 3, [float("inf")] * 4, {"a": [1e300]}, [[0.0] * 3] * 3),
]
GONE = object()
Twist = tuple[float, Any]
"""Which of the values of a document (0 to 1), and what takes its place."""
DTYPES = ["<f8", "<f4", "<f2", "<i8", "<i2", "u1", "?", "<U3", "S4", "<c8", "<M8[s]", "V4"]


def cuts() -> st.SearchStrategy[list[Cut]]:
    """Damage to the bytes of any file."""
    place = st.floats(0, 1)
    filling = st.one_of(st.sampled_from(NASTY_BYTES), st.binary(max_size=8), st.just(b""))
    return st.lists(st.tuples(place, place, filling), min_size=1, max_size=6)


def damaged(content: bytes, found: list[Cut]) -> bytes:
    """The bytes after these cuts."""
    for place, size, filling in found:
        start = round(place * len(content))
        content = content[:start] + filling + content[start + round(size * 40) :]
    return content


def twists() -> st.SearchStrategy[list[Twist]]:
    """Damage to the values of a document of mappings and lists."""
    filling = st.one_of(st.sampled_from([*NASTY_VALUES, GONE]), st.floats(), st.integers())
    return st.lists(st.tuples(st.floats(0, 1), filling), min_size=1, max_size=3)


def twisted(document: Any, found: list[Twist]) -> Any:
    """The document with some of its values replaced or gone."""
    whole = {"": copy.deepcopy(document)}
    for place, filling in found:
        holders = list(_places(whole))
        holder, key = holders[round(place * (len(holders) - 1))]
        if filling is not GONE:
            holder[key] = copy.deepcopy(filling)
        elif holder is not whole:
            del holder[key]
    return whole[""]


def of_another_type(document: Any) -> Iterator[Any]:
    """The document with one of its numbers or truth values as the other, or as a text."""
    for place, (holder, key) in enumerate(_places(document)):
        value = holder[key]
        if isinstance(value, int | float):
            number = int(value) if isinstance(value, bool) else True
            for other in (number, json.dumps(value)):
                changed = copy.deepcopy(document)
                inner, name = list(_places(changed))[place]
                inner[name] = other
                yield changed


def _places(holder: Any) -> Any:
    keys = list(holder) if isinstance(holder, dict) else range(len(holder))
    for key in keys:
        yield holder, key
        if isinstance(holder[key], dict | list):
            yield from _places(holder[key])


Bend = tuple[float, str, int]
"""Which of the arrays of an archive (0 to 1), what is done to it, and a number for that."""
BENDS = ["gone", "empty", "flat", "shorter", "longer", "scalar", "deeper", "type", "value"]


def bends() -> st.SearchStrategy[list[Bend]]:
    """Damage to the arrays of an archive that stays a good one."""
    one = st.tuples(st.floats(0, 1), st.sampled_from(BENDS), st.integers(0, 1000))
    return st.lists(one, min_size=1, max_size=3)


def bent(arrays: dict[str, np.ndarray], found: list[Bend]) -> dict[str, np.ndarray]:
    """The arrays with other shapes, types or values."""
    arrays = dict(arrays)
    for place, what, number in found:
        if not arrays:
            break
        names = sorted(arrays)
        name = names[round(place * (len(names) - 1))]
        array = arrays.pop(name)
        if what != "gone":
            arrays[name] = _bend(np.asarray(array), what, number)
    return arrays


def _bend(array: np.ndarray, what: str, number: int) -> np.ndarray:
    if what == "type":
        target = np.dtype(DTYPES[number % len(DTYPES)])
        return np.zeros(array.shape, target) if number % 2 else _cast(array, target)
    if what == "value" and array.size and array.dtype.kind in "fiu":
        value = NASTY_NUMBERS[number % len(NASTY_NUMBERS)] if number % 5 else np.nan
        spoilt = array.astype(float)
        spoilt.flat[number % array.size] = value
        return spoilt if number % 3 else _cast(spoilt, array.dtype)
    shapes = {
        "empty": np.zeros((0, *array.shape[1:]), array.dtype),
        "flat": array.ravel(),
        "shorter": array[:-1] if array.ndim else array,
        "longer": np.concatenate([array, array[:1]]) if array.ndim else array[None],
        "scalar": array.ravel()[0] if array.size else np.zeros((), array.dtype),
        "deeper": array[None],
    }
    return np.asarray(shapes.get(what, array))


def _cast(array: np.ndarray, target: np.dtype) -> np.ndarray:
    array = array.real if array.dtype.kind == "c" else array
    try:
        with np.errstate(all="ignore"):
            return array.astype(target)
    except (RuntimeError, TypeError, ValueError):
        return np.zeros(array.shape, target)
