"""Files that survive a kill, a full disk and a loss of power."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from geometry.atomic import atomic_path, is_unfinished, sync_tree, write_text_atomic
from geometry.disk_space import check_space


@pytest.fixture
def events(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Every sync and rename, in order, by the name of the file."""
    seen: list[tuple[str, str]] = []

    def recorded(what: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(one: Any, *more: Any) -> Any:
            path = Path(f"/proc/self/fd/{one}").readlink() if isinstance(one, int) else one
            seen.append((what, path.name))
            return real(one, *more)

        return call

    monkeypatch.setattr(os, "fsync", recorded("sync", os.fsync))
    monkeypatch.setattr(Path, "replace", recorded("rename", Path.replace))
    return seen


def test_content_is_on_the_disk_before_the_name_is(
    tmp_path: Path, events: list[tuple[str, str]]
) -> None:
    write_text_atomic(tmp_path / "a.txt", "whole")
    (first, written), (second, renamed), (third, folder) = events
    assert (first, second, third) == ("sync", "rename", "sync")
    assert written == renamed
    assert is_unfinished(Path(written))
    assert folder == tmp_path.name
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_tree_is_on_the_disk_with_all_that_is_in_it(
    tmp_path: Path, events: list[tuple[str, str]]
) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "a").write_text("a")
    (tmp_path / "b").write_text("b")
    sync_tree(tmp_path)
    assert {name for _, name in events} == {"inner", "a", "b", tmp_path.name}


def test_a_disk_that_fails_to_sync_keeps_what_stood_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.txt").write_text("before")

    def fail(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="Input/output error") as raised:
        write_text_atomic(tmp_path / "a.txt", "after")
    assert raised.value.filename
    assert (tmp_path / "a.txt").read_text() == "before"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_file_system_that_cannot_sync_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: int) -> None:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(os, "fsync", fail)
    with atomic_path(tmp_path / "a.txt") as path:
        path.write_text("a")
    assert (tmp_path / "a.txt").read_text() == "a"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_too_little_room_is_said_with_what_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def fail(*_: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "posix_fallocate", fail)
    with pytest.raises(OSError, match="6 MiB are needed") as raised:
        check_space(tmp_path, 5 * 2**20 + 1)
    assert raised.value.filename == str(tmp_path)
    assert raised.value.errno == number
    assert not list(tmp_path.iterdir())


def test_room_that_is_there_is_given_back(tmp_path: Path) -> None:
    check_space(tmp_path, 2**20)
    assert not list(tmp_path.iterdir())


def test_a_file_system_that_sets_no_room_aside_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: int) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    monkeypatch.setattr(os, "posix_fallocate", fail)
    check_space(tmp_path, 2**20)
