"""Texts of any hand are read in one way, or refused in one line that says why."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import Field, ValidationError

from geometry import regular_files, text_files
from geometry.errors import BadInputError
from geometry.named_paths import resolve_path
from geometry.plain_settings import PlainSettings
from geometry.regular_files import append_regular, open_regular, read_content
from geometry.text_files import read_json, read_text, read_yaml

READ: list[Callable[[Path], Any]] = [read_json, read_yaml]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("read", READ)
def test_a_mark_before_a_text_is_no_part_of_it(
    tmp_path: Path, read: Callable[[Path], Any], encoding: str
) -> None:
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    (tmp_path / "a").write_bytes((mark + '{"Größe": [1]}').encode(encoding))
    assert read(tmp_path / "a") == {"Größe": [1]}


@pytest.mark.parametrize("read", READ)
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'{"a": 1, "b": {"c": 1, "c": 1}}', r"a: 'c' is given twice; keep one$"),
        (b'{"a": ', "a: not (JSON|YAML) "),
        (b"\xff\xff", "a: no text in UTF-8 or UTF-16; save it as UTF-8"),
        (b"[" * 100_000, "a: nested too deeply"),
        (b"[1" + b"0" * 100 + b"]", "a: a whole number of 101 digits"),
    ],
    ids=["twice", "cut short", "no text", "deep", "digits"],
)
def test_what_is_wrong_is_said(
    tmp_path: Path, read: Callable[[Path], Any], content: bytes, said: str
) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(BadInputError, match=said):
        read(tmp_path / "a")


def test_long_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_files, "MOST_TEXT_BYTES", 10)
    monkeypatch.setattr(regular_files, "MOST_BYTES", 10)
    (tmp_path / "a").write_text("x" * 11)
    with pytest.raises(BadInputError, match="a text over 0 MiB"):
        read_text(tmp_path / "a")
    with pytest.raises(OSError, match="over 0 MiB"):
        read_content(tmp_path / "a")


@pytest.mark.parametrize("use", [open_regular, read_content, append_regular])
def test_pipes_and_folders_are_not_opened(tmp_path: Path, use: Callable[[Path], object]) -> None:
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    with pytest.raises(OSError, match="a pipe or a device"):
        use(tmp_path / "pipe")
    os.close(reader)
    with pytest.raises(IsADirectoryError):
        use(tmp_path)


def test_a_pipe_that_nobody_reads_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="pipe"):
        append_regular(tmp_path / "pipe")


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(BadInputError, match="in a circle"):
        resolve_path(tmp_path / "a" / "file")


class Inner(PlainSettings):
    on: bool = False
    size: int = 1


class Outer(PlainSettings):
    path: Path = Path("a")
    share: float | None = None
    ends: tuple[float, float] = (0.0, 1.0)
    weights: dict[str, float] = Field(default_factory=dict)
    inner: Inner | None = None
    extra: dict[str, Any] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("share: yes", "share: yes and no"),
        ("ends: [0, on]", "ends: yes and no"),
        ("weights: {a: true}", "weights: yes and no"),
        ("inner: {size: true}", "size: yes and no"),
        ('path: "a\\0b"', "path: holds a zero byte"),
        ("shares: 1", "shares"),
    ],
)
def test_settings_hold_numbers_where_they_need_them(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(ValidationError, match=said):
        Outer.model_validate(read_yaml(tmp_path / "a.yaml"))
    good = {"inner": {"on": True}, "extra": {"a": [True]}, "ends": [0, 2], "share": None}
    assert Outer.model_validate(good).ends == (0.0, 2.0)
