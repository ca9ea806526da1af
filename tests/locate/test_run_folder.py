import errno
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from geometry.atomic import atomic_path
from geometry.errors import BadInputError
from locate.pipeline.run_folder import RunFolder
from locate.pipeline.stage import Stage


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
        folder.complete(Stage(name="one", inputs={"v": value}), make(str(value), calls))
    assert calls == ["1", "2"]
    assert (tmp_path / "answer.txt").read_text() == "2"


def test_later_stage_follows_an_earlier_one(tmp_path: Path) -> None:
    calls: list[str] = []
    for value in (1, 2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.complete(Stage(name="one", inputs={"v": value}), make("one", calls))
        folder.complete(Stage(name="two", after=("one",), inputs={}), make("two", calls))
    assert calls == ["one", "two", "one", "two"]


def test_missing_output_is_made_again(tmp_path: Path) -> None:
    calls: list[str] = []
    for _ in range(2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.complete(Stage(name="one", inputs={}), make("x", calls))
        (tmp_path / "answer.txt").unlink()
    assert calls == ["x", "x"]


def test_force_does_everything_again(tmp_path: Path) -> None:
    calls: list[str] = []
    for force in (False, True):
        folder = RunFolder(tmp_path, force=force)
        folder.save_config({})
        folder.complete(Stage(name="one", inputs={}), make("x", calls))
    assert calls == ["x", "x"]


def test_failed_stage_leaves_no_output_and_keeps_its_workshop(tmp_path: Path) -> None:
    def breaks(folder: Path) -> str:
        (folder / "answer.txt").write_text("half")
        raise RuntimeError

    folder = RunFolder(tmp_path)
    folder.save_config({})
    with pytest.raises(RuntimeError):
        folder.complete(Stage(name="one", inputs={}), breaks)
    assert not (tmp_path / "answer.txt").exists()

    def goes_on(workshop: Path) -> str:
        return (workshop / "answer.txt").read_text()

    folder = RunFolder(tmp_path)
    folder.complete(Stage(name="one", inputs={}), goes_on)
    assert folder.times[0].note == "half"


def test_results_of_another_kind_of_run_are_withdrawn(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.save_config({})
    folder.complete(Stage(name="one", inputs={}), make("x", []))
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
        folder.complete(Stage(name="one", inputs={}), make("x", calls))
        (tmp_path / ".stages" / "one.json").write_text(stamp)
    assert calls == ["x", "x"]


def test_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot be written"):
        RunFolder(tmp_path / "file")


def test_stage_times_survive_a_skip(tmp_path: Path) -> None:
    for _ in range(2):
        folder = RunFolder(tmp_path)
        folder.save_config({})
        folder.complete(Stage(name="one", inputs={}), make("x", []))
    stamp = json.loads((tmp_path / ".stages" / "one.json").read_text())
    assert folder.times[0].wall_s == stamp["time"]["wall_s"]


def test_shares_of_a_stage_are_put_together_by_it(tmp_path: Path) -> None:
    def share(name: str):
        def build(folder: Path) -> str:
            (folder / name).write_text(name)
            return name

        return build

    for name in ("a", "b"):
        RunFolder(tmp_path / "run").begin(Stage(name="look", inputs={}), share(name))
    assert not (tmp_path / "run" / "a").exists()
    folder = RunFolder(tmp_path / "run")
    folder.save_config({})
    folder.complete(Stage(name="look", inputs={}), share("c"))
    assert [(tmp_path / "run" / name).read_text() for name in "abc"] == ["a", "b", "c"]

    def never(_: Path) -> str:
        raise AssertionError

    RunFolder(tmp_path / "run").begin(Stage(name="look", inputs={}), never)


def stamp_of(outputs: object, **more: object) -> str:
    time = {"name": "one", "wall_s": 1.0, "cpu_s": 1.0, "note": ""}
    return json.dumps({"fingerprint": "x", "outputs": outputs, "time": time} | more)


HOSTILE_STAMPS = [
    stamp_of("ab"),
    stamp_of(["../victim"]),
    stamp_of(["deep/../../victim"]),
    stamp_of(["/VICTIM"]),
    stamp_of(["answer.txt", "../victim"]),
    stamp_of([".."]),
    stamp_of([".stages"]),
    stamp_of(["config.yaml"]),
    stamp_of(["log.jsonl"]),
    stamp_of([["a"]]),
    stamp_of({"a": 1}),
    stamp_of(None),
    stamp_of(["a"], time={"name": "one", "wall_s": 1.0, "cpu_s": "1"}),
    stamp_of(["a"], fingerprint=1),
]


@pytest.mark.parametrize("stamp", HOSTILE_STAMPS)
def test_a_stamp_that_names_anything_but_outputs_is_no_stamp(
    tmp_path: Path, stamp: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, victim = tmp_path / "run", tmp_path / "victim"
    victim.mkdir()
    folder = RunFolder(root)
    folder.save_config({})
    folder.complete(Stage(name="one", inputs={}), make("x", []))
    (root / "a").write_text("")
    (root / "b").write_text("")
    (root / ".stages" / "one.json").write_text(stamp.replace("/VICTIM", str(victim)))
    (root / ".stages" / "gone.json").write_text(stamp.replace("/VICTIM", str(victim)))
    removed: list[Path] = []
    monkeypatch.setattr("geometry.removal.shutil.rmtree", removed.append)
    calls: list[str] = []
    folder = RunFolder(root)
    folder.complete(Stage(name="one", inputs={}), make("again", calls))
    folder.withdraw_others()
    assert calls == ["again"]
    assert not [path for path in removed if root not in path.parents]
    for path in (victim, root / "a", root / "b", root / "config.yaml", root / ".stages"):
        assert path.exists(), path
    assert (root / "answer.txt").read_text() == "again"


@pytest.mark.parametrize("name", [".stages", ".partial", "config.yaml", "log.jsonl"])
def test_a_run_folder_whose_own_files_are_links_to_elsewhere_is_refused(
    tmp_path: Path, name: str
) -> None:
    root, victim = tmp_path / "run", tmp_path / "victim"
    folder = RunFolder(root)
    folder.save_config({})
    content = (root / "config.yaml").read_text()
    if name.startswith("."):
        (root / name).rmdir()
        victim.mkdir()
    else:
        (root / name).unlink(missing_ok=True)
        victim.write_text(content)
    (root / name).symlink_to(victim)
    with pytest.raises(BadInputError, match="leads outside"):
        RunFolder(root)
    assert victim.exists()


def test_an_output_that_became_a_link_to_elsewhere_is_refused(tmp_path: Path) -> None:
    root, victim = tmp_path / "run", tmp_path / "victim"
    victim.write_text("mine")
    folder = RunFolder(root)
    folder.save_config({})
    folder.complete(Stage(name="one", inputs={}), make("x", []))
    (root / "answer.txt").unlink()
    (root / "answer.txt").symlink_to(victim)
    with pytest.raises(BadInputError, match=r"answer\.txt: leads outside"):
        RunFolder(root).complete(Stage(name="one", inputs={"v": 2}), make("y", []))
    assert victim.read_text() == "mine"


def test_a_workshop_with_a_link_in_it_is_begun_anew(tmp_path: Path) -> None:
    root, victim = tmp_path / "run", tmp_path / "victim"
    victim.mkdir()
    folder = RunFolder(root)
    folder.save_config({})

    def plants_a_link(workshop: Path) -> str:
        (workshop / "frames").symlink_to(victim)
        raise RuntimeError

    with pytest.raises(RuntimeError):
        folder.complete(Stage(name="one", inputs={}), plants_a_link)

    def writes(workshop: Path) -> str:
        (workshop / "frames").mkdir()
        (workshop / "frames" / "000000.png").write_text("")
        return "done"

    RunFolder(root).complete(Stage(name="one", inputs={}), writes)
    assert not list(victim.iterdir())
    assert (root / "frames" / "000000.png").is_file()


def test_a_stamp_that_was_never_finished_withdraws_nothing(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.save_config({})
    folder.complete(Stage(name="one", inputs={}), make("x", []))
    stamp = tmp_path / ".stages" / "one.json"
    stamp.with_name(".one.123.partial.json").write_bytes(stamp.read_bytes())
    again = RunFolder(tmp_path)
    again.complete(Stage(name="one", inputs={}), make("x", []))
    again.withdraw_others()
    assert (tmp_path / "answer.txt").exists()


def finish(root: Path, build=None, **inputs: object) -> RunFolder:
    """A run of one stage, "one"; as `Run.run` does it."""
    folder = RunFolder(root)
    with folder.hold():
        folder.save_config({})
        folder.complete(Stage(name="one", inputs=inputs), build or make("x", []))
        folder.withdraw_others()
    return folder


def tree(root: Path) -> dict[str, bytes]:
    """Every file of a run folder but the log and the times of its stamps."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and path.parent.name != ".stages" and path.name != "log.jsonl"
    }


def test_a_second_run_on_the_folder_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    def build(_: Path) -> str:
        before = tree(tmp_path)
        for shared in (False, True):
            with (
                pytest.raises(BadInputError, match="another command is at work"),
                RunFolder(tmp_path).hold(shared=shared),
            ):
                raise AssertionError
        assert tree(tmp_path) == before
        return "done"

    finish(tmp_path, build)
    finish(tmp_path, build, v=2)


def test_shares_of_a_stage_hold_the_folder_together_and_keep_a_run_away(tmp_path: Path) -> None:
    with (
        RunFolder(tmp_path).hold(shared=True),
        RunFolder(tmp_path).hold(shared=True),
        pytest.raises(BadInputError, match="at work"),
        RunFolder(tmp_path).hold(),
    ):
        raise AssertionError
    with RunFolder(tmp_path).hold():
        pass


def test_the_lock_of_a_killed_process_is_gone(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from locate.pipeline.run_folder import RunFolder\n"
        "with RunFolder(Path(sys.argv[1])).hold():\n    print('held', flush=True); input()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(BadInputError, match="at work"), RunFolder(tmp_path).hold():
            raise AssertionError
        process.kill()
    finish(tmp_path)


def make_many(calls: list[str], content: str = "abc"):
    def build(folder: Path) -> str:
        calls.append("made")
        (folder / "frames" / "deep").mkdir(parents=True)
        for name in ("a.txt", "frames/0.txt", "frames/deep/1.txt"):
            (folder / name).write_text(content)
        return "done"

    return build


@pytest.mark.parametrize("name", ["a.txt", "frames/0.txt", "frames/deep/1.txt"])
@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "gone", "folder", "link"])
def test_a_damaged_output_is_noticed_and_made_again(tmp_path: Path, name: str, damage: str) -> None:
    root = tmp_path / "run"
    calls: list[str] = []
    finish(root, make_many(calls))
    whole = tree(root)
    path = root / name
    status = path.stat()
    if damage in ("flip", "cut", "empty"):
        path.write_text({"flip": "abd", "cut": "ab", "empty": ""}[damage])
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    else:
        path.unlink()
        if damage == "folder":
            path.mkdir()
        if damage == "link":
            (root / ".partial" / "same").write_text("abc")
            path.symlink_to(root / ".partial" / "same")
    finish(root, make_many(calls))
    assert tree(root) == whole
    assert calls == ["made", "made"]
    assert not path.is_symlink()
    finish(root, make_many(calls))
    assert calls == ["made", "made"]


def test_a_stamp_without_digests_is_no_stamp(tmp_path: Path) -> None:
    calls: list[str] = []
    finish(tmp_path, make_many(calls))
    path = tmp_path / ".stages" / "one.json"
    stamp = json.loads(path.read_text())
    del stamp["files"]
    path.write_text(json.dumps(stamp))
    finish(tmp_path, make_many(calls))
    assert calls == ["made", "made"]


class KilledHereError(BaseException):
    """In place of a kill: nothing cleans up behind it."""


CHANGES = ("replace", "rename", "unlink", "rmdir", "mkdir")
"""What changes a folder; a process may be killed before each."""


def test_killed_at_any_change_of_the_folder_it_ends_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(root: Path, value: int, names: tuple[str, ...]) -> None:
        def build(folder: Path) -> str:
            for name in names:
                with atomic_path(folder / name) as path:
                    path.write_text(f"{name} {value}")
            return "done"

        finish(root, build, v=value)

    run(tmp_path / "whole", 2, ("a", "c"))
    whole = tree(tmp_path / "whole")
    for killed_at in range(200):
        root = tmp_path / f"run{killed_at}"
        count = iter(range(1000))
        with monkeypatch.context() as patch:
            for name in CHANGES:
                patch.setattr(Path, name, dying(getattr(Path, name), count, killed_at))
            try:
                run(root, 1, ("a", "b"))
                run(root, 2, ("a", "c"))
                break
            except KilledHereError:
                pass
        run(root, 2, ("a", "c"))
        assert tree(root) == whole
        assert [path.name for path in (root / ".stages").iterdir()] == ["one.json"]
        shutil.rmtree(root)
    assert killed_at > 20


def dying(method, count: Iterator[int], killed_at: int):
    def change(path: Path, *given, **named):
        if next(count) >= killed_at:  # also all that would clean up
            raise KilledHereError
        return method(path, *given, **named)

    return change


def test_killed_at_its_first_file_the_folder_is_not_refused(tmp_path: Path) -> None:
    (tmp_path / ".config.123-45ab.partial.yaml").write_text("schema: loc")
    finish(tmp_path)
    assert not list(tmp_path.glob(".config*"))


@pytest.mark.parametrize("content", [None, b"", b"\xff\x00", b"[" * 2_000])
def test_a_lost_configuration_of_a_finished_run_is_written_anew(
    tmp_path: Path, content: bytes | None
) -> None:
    calls: list[str] = []
    finish(tmp_path, make_many(calls))
    config = (tmp_path / "config.yaml").read_bytes()
    (tmp_path / "config.yaml").unlink()
    if content is not None:
        (tmp_path / "config.yaml").write_bytes(content)
    finish(tmp_path, make_many(calls))
    assert calls == ["made"]
    assert (tmp_path / "config.yaml").read_bytes() == config


@pytest.mark.parametrize(
    "number", ["EIO", "EROFS", "EACCES", "ENOSPC", "EDQUOT", "ENAMETOOLONG", "EMFILE"]
)
def test_an_error_of_the_system_is_one_line_with_what_is_kept(tmp_path: Path, number: str) -> None:
    error = getattr(errno, number)

    def breaks(folder: Path) -> str:
        raise OSError(error, os.strerror(error), str(folder / "x"))

    folder = RunFolder(tmp_path)
    with folder.hold():
        folder.save_config({})
        folder.complete(Stage(name="one", inputs={}), make("x", []))
        with pytest.raises(BadInputError) as caught:
            folder.complete(Stage(name="two", after=("one",), inputs={}), breaks)
    text = str(caught.value)
    assert "two failed" in text
    assert os.strerror(error) in text
    assert "kept: one;" in text
    assert "\n" not in text


def test_a_pipe_in_place_of_the_log_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.jsonl")
    with pytest.raises(BadInputError, match="not a file"):
        RunFolder(tmp_path)


def test_results_are_on_the_disk_before_they_are_in_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []
    fsync, replace = os.fsync, Path.replace

    def record_sync(descriptor: int) -> None:
        events.append(f"sync {Path(f'/proc/self/fd/{descriptor}').readlink().name}")
        fsync(descriptor)

    def record_move(path: Path, target: Path) -> Path:
        events.append(f"move {path.name}")
        return replace(path, target)

    folder = RunFolder(tmp_path)
    monkeypatch.setattr(os, "fsync", record_sync)
    monkeypatch.setattr(Path, "replace", record_move)
    folder.complete(Stage(name="one", inputs={}), make("x", []))
    moved = events.index("move answer.txt")
    assert events.index("sync answer.txt") < moved
    assert f"sync {tmp_path.name}" in events[moved:]
