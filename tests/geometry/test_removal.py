"""Nothing here points outside the test's own temporary folder."""

from pathlib import Path

import pytest

from geometry.errors import BadInputError
from geometry.removal import is_plain_name, path_inside, remove_inside


@pytest.mark.parametrize("name", ["", ".", "..", "../x", "a/b", "/x", "a\0b", 3, None, ["a"]])
def test_only_the_name_of_one_thing_is_plain(name: object) -> None:
    assert not is_plain_name(name)


@pytest.mark.parametrize("name", ["map.json", "frames", "...", "with space", ".hidden"])
def test_plain_names(name: str) -> None:
    assert is_plain_name(name)


def test_what_lies_inside_is_removed_and_what_is_missing_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "folder" / "deep").mkdir(parents=True)
    (tmp_path / "file").write_text("")
    for name in ("folder", "file", "missing"):
        remove_inside(tmp_path, name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["../victim", "deep/../../victim", ".", ""])
def test_what_lies_outside_is_refused(tmp_path: Path, name: str) -> None:
    folder, victim = tmp_path / "folder", tmp_path / "victim"
    (folder / "deep").mkdir(parents=True)
    victim.mkdir()
    with pytest.raises(BadInputError, match="leads outside"):
        remove_inside(folder, name)
    with pytest.raises(BadInputError, match="leads outside"):
        remove_inside(folder, str(victim))
    assert victim.is_dir()
    assert folder.is_dir()


def test_a_link_that_leads_outside_is_refused(tmp_path: Path) -> None:
    folder, victim = tmp_path / "folder", tmp_path / "victim"
    folder.mkdir()
    victim.mkdir()
    (folder / "link").symlink_to(victim)
    with pytest.raises(BadInputError, match="remove this link"):
        remove_inside(folder, "link")
    with pytest.raises(BadInputError, match="leads outside"):
        path_inside(folder, "link/below")
    assert victim.is_dir()


def test_of_a_link_that_stays_inside_only_the_link_is_removed(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    remove_inside(tmp_path, "link")
    assert not (tmp_path / "link").is_symlink()
    assert (tmp_path / "folder").is_dir()
