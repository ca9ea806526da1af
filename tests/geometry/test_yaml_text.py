"""YAML from strangers: what it says, or one line."""

from pathlib import Path

import pytest

from detect.learning.config import TrainConfig
from detect.synthesis.recipe import Recipe
from geometry.errors import BadInputError
from geometry.yaml_text import parse_yaml
from locate.simulation.scene import Scene

LEVELS = 12
UNFOLDING = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, LEVELS)
)
HOSTILE = {
    "deep": b"[" * 2_000,
    "unfolding": UNFOLDING.encode(),
    "in itself": b"&a [*a]",
    "date": b"a: 2020-99-99",
    "a key twice": b"seed: 1\nseed: 2",
    "merges": b"a0: &a0 {x: 1}\n"
    + b"".join(b"a%d: &a%d {<<: [*a%d, *a%d]}\n" % (i, i, i - 1, i - 1) for i in range(1, 40)),
    "base 60": b"a: " + b":".join([b"59"] * 80_000),
    "base 60 with a point": b"a: " + b":".join([b"59"] * 80_000) + b".5",
    "long": b"a: [" + b"{b: 1}, " * 100_000 + b"]",
    "hexadecimal": b"a: 0x" + b"f" * 80_000,
    "no text": b"\xff\xfe\x00\x9f",
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("reader", [Scene, Recipe, TrainConfig])
def test_hostile_yaml_is_refused_in_one_short_line(
    tmp_path: Path, name: str, reader: type[Scene] | type[Recipe] | type[TrainConfig]
) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(HOSTILE[name])
    with pytest.raises(BadInputError, match=r"a\.yaml") as refused:
        reader.load(path)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 1000


def test_a_value_in_itself_is_refused() -> None:
    with pytest.raises(ValueError, match="nested"):
        parse_yaml("&a [*a]")


def test_a_key_that_is_given_twice_is_named() -> None:
    with pytest.raises(ValueError, match="'effort' is given twice; keep one"):
        parse_yaml("a: {effort: quick, seed: 1, effort: usual}")
    assert parse_yaml('{1: a, "1": b}') == {1: "a", "1": "b"}


def test_usual_aliases_are_read() -> None:
    assert parse_yaml("a: &x {b: 1}\nc: *x") == {"a": {"b": 1}, "c": {"b": 1}}
