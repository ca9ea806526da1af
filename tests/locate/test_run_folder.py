import json
from pathlib import Path

import pytest
import yaml

from geometry.errors import BadInputError
from locate.run_folder import RunFolder, fingerprint_of


def make(text: str, calls: list[str]):
    def build(folder: Path) -> str:
        calls.append(text)
        (folder / "answer.txt").write_text(text)
        return "done"

    return build


def test_stage_is_skipped_while_its_inputs_stand(tmp_path: Path) -> None:
    calls: list[str] = []
    for value in (1, 1, 2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.stage("one", inputs={"v": value}, build=make(str(value), calls))
    assert calls == ["1", "2"]
    assert (tmp_path / "answer.txt").read_text() == "2"


def test_later_stage_follows_an_earlier_one(tmp_path: Path) -> None:
    calls: list[str] = []
    for value in (1, 2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.stage("one", inputs={"v": value}, build=make("one", calls))
        folder.stage("two", after=("one",), inputs={}, build=make("two", calls))
    assert calls == ["one", "two", "one", "two"]


def test_missing_output_is_made_again(tmp_path: Path) -> None:
    calls: list[str] = []
    for _ in range(2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.stage("one", inputs={}, build=make("x", calls))
        (tmp_path / "answer.txt").unlink()
    assert calls == ["x", "x"]


def test_force_does_everything_again(tmp_path: Path) -> None:
    calls: list[str] = []
    for force in (False, True):
        folder = RunFolder(tmp_path, force=force)
        folder.save_config({})
        folder.stage("one", inputs={}, build=make("x", calls))
    assert calls == ["x", "x"]


def test_failed_stage_leaves_no_output_and_keeps_its_workshop(tmp_path: Path) -> None:
    def breaks(folder: Path) -> str:
        (folder / "answer.txt").write_text("half")
        raise RuntimeError

    folder = RunFolder(tmp_path)
    folder.save_config({})
    with pytest.raises(RuntimeError):
        folder.stage("one", inputs={}, build=breaks)
    assert not (tmp_path / "answer.txt").exists()

    def goes_on(workshop: Path) -> str:
        return (workshop / "answer.txt").read_text()

    folder = RunFolder(tmp_path)
    folder.stage("one", inputs={}, build=goes_on)
    assert folder.times[0].note == "half"


def test_results_of_another_kind_of_run_are_withdrawn(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.save_config({})
    folder.stage("one", inputs={}, build=make("x", []))
    folder = RunFolder(tmp_path)
    folder.withdraw_others()
    assert not (tmp_path / "answer.txt").exists()
    assert not (tmp_path / ".stages" / "one.json").exists()


def test_foreign_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(BadInputError, match="not empty and not a run folder"):
        RunFolder(tmp_path)


def test_folder_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"schema": "locate.run/99"}))
    with pytest.raises(BadInputError, match=r"locate\.run/99"):
        RunFolder(tmp_path)


@pytest.mark.parametrize("text", ["[", "just text", "{}"])
def test_damaged_config_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(BadInputError, match=r"config\.yaml"):
        RunFolder(tmp_path)


@pytest.mark.parametrize("stamp", ["{", "{}", "[]", "null"])
def test_damaged_stamp_means_do_it_again(tmp_path: Path, stamp: str) -> None:
    calls: list[str] = []
    for _ in range(2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.stage("one", inputs={}, build=make("x", calls))
        (tmp_path / ".stages" / "one.json").write_text(stamp)
    assert calls == ["x", "x"]


def test_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot be written"):
        RunFolder(tmp_path / "file")


def test_fingerprint_sees_content_and_names(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    first = fingerprint_of(tmp_path)
    (tmp_path / "a").write_bytes(b"2")
    second = fingerprint_of(tmp_path)
    (tmp_path / "a").rename(tmp_path / "b")
    assert len({first, second, fingerprint_of(tmp_path)}) == 3


def test_stage_times_survive_a_skip(tmp_path: Path) -> None:
    for _ in range(2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.stage("one", inputs={}, build=make("x", []))
    stamp = json.loads((tmp_path / ".stages" / "one.json").read_text())
    assert folder.times[0].wall_s == stamp["time"]["wall_s"]


def test_shares_of_a_stage_are_put_together_by_it(tmp_path: Path) -> None:
    def share(name: str):
        def build(folder: Path) -> str:
            (folder / name).write_text(name)
            return name

        return build

    for name in ("a", "b"):
        RunFolder(tmp_path / "run").begin("look", inputs={}, build=share(name))
    assert not (tmp_path / "run" / "a").exists()
    folder = RunFolder(tmp_path / "run")
    folder.save_config({})
    folder.stage("look", inputs={}, build=share("c"))
    assert [(tmp_path / "run" / name).read_text() for name in "abc"] == ["a", "b", "c"]

    def never(_: Path) -> str:
        raise AssertionError

    RunFolder(tmp_path / "run").begin("look", inputs={}, build=never)
