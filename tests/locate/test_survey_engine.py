import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

import pytest

from geometry.errors import BadInputError
from locate.survey import engine
from locate.survey.engine import LOCAL, map_flights

distributed = pytest.importorskip("distributed")
cloudpickle = pytest.importorskip("cloudpickle")
cloudpickle.register_pickle_by_value(sys.modules[__name__])
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")

GROUPS = (("frames",), ("see 0", "see 1"))
NAMES = ["a", "b", "c"]


@dataclass(frozen=True, kw_only=True)
class Work:
    """Leaves a line for each part it does in FOLDER/item; a part that stands is not done again."""

    folder: Path
    slow: str = ""
    deadly: str = ""
    blamed: str = ""

    def list_parts(self, item):
        return GROUPS

    def do_part(self, item, name):
        place, line = self.folder / item, f"{name} {os.getpid()}\n"
        if place.exists() and any(old.startswith(name) for old in place.read_text().splitlines()):
            return None
        if name == "frames" and item == self.blamed:
            return "too dark"
        if name == "see 0" and item == self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)
        if name == "see 0" and item == self.slow:
            if not (self.folder / "busy").exists():
                (self.folder / "busy").write_text(str(os.getpid()))
            while not (self.folder / "go").exists():
                time.sleep(0.05)
        with place.open("a") as file:
            file.write(line)
        return None

    def __call__(self, item):
        for group in GROUPS:
            for name in group:
                self.do_part(item, name)
        return sorted(name for name, _ in lines(self.folder / item))

    def failed_result(self, item, why):
        return why


DONE = sorted(name for group in GROUPS for name in group)


@pytest.fixture(autouse=True)
def two_cores(monkeypatch):
    monkeypatch.setattr(engine, "count_cores", lambda: 2)


def wait_for(path: Path) -> str:
    for _ in range(3600):
        if path.exists() and path.read_text():
            return path.read_text()
        time.sleep(0.05)
    raise AssertionError(f"{path} never came")


@contextmanager
def killed_when_busy(folder: Path, pid: int | None = None):
    """Kills a process once the slow part is being done: by default the worker that is at it."""

    def kill():
        busy = int(wait_for(folder / "busy"))
        os.kill(busy if pid is None else pid, signal.SIGKILL)
        if pid is None:
            (folder / "go").touch()

    watcher = Thread(target=kill)
    watcher.start()
    try:
        yield
    finally:
        watcher.join()


def test_one_process_does_one_after_the_other(tmp_path):
    answers = list(map_flights(Work(folder=tmp_path), NAMES))
    assert answers == [(name, DONE) for name in NAMES]
    assert {pid for name in NAMES for pid in pids(tmp_path / name)} == {str(os.getpid())}


def lines(path: Path) -> list[list[str]]:
    """Part and process of each line."""
    return [line.rsplit(" ", 1) for line in path.read_text().splitlines()]


def pids(path: Path) -> list[str]:
    return [pid for _, pid in lines(path)]


def test_a_killed_worker_costs_the_task_it_was_at(tmp_path):
    with killed_when_busy(tmp_path):
        answers = dict(map_flights(Work(folder=tmp_path, slow="b"), NAMES, LOCAL))
    assert answers == dict.fromkeys(NAMES, DONE)
    killed = (tmp_path / "busy").read_text()
    workers = {pid for name in NAMES for pid in pids(tmp_path / name)}
    assert str(os.getpid()) not in workers
    assert len(workers | {killed}) >= 2
    for name in NAMES:
        assert len(pids(tmp_path / name)) == len(DONE)  # nothing was done twice
    assert killed not in [pid for line, pid in lines(tmp_path / "b") if line == "see 0"]


def test_what_kills_every_worker_is_left_out(tmp_path):
    import dask

    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        answers = dict(map_flights(Work(folder=tmp_path, deadly="c", blamed="a"), NAMES, LOCAL))
    assert answers["a"] == "too dark"
    assert answers["b"] == DONE
    assert "too little memory" in answers["c"]
    assert not (tmp_path / "a").exists()


def test_a_lost_scheduler_costs_no_finished_part(tmp_path):
    environment = dict(os.environ, PYTHONWARNINGS="ignore")
    address_file = ("--scheduler-file", str(tmp_path / "s.json"), "--no-dashboard")

    def start(program: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{program}", *address_file, *options]
        return subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)

    scheduler = start("scheduler", "--port", "0")
    address = json.loads(wait_for(tmp_path / "s.json"))["address"]
    worker = start("worker", "--nthreads", "1", "--death-timeout", "60")
    try:
        answers = map_flights(Work(folder=tmp_path, slow="b"), ["b"], address)
        with (
            killed_when_busy(tmp_path, scheduler.pid),
            pytest.raises(BadInputError, match=r"scheduler was lost.*goes on"),
        ):
            list(answers)
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()
    (tmp_path / "go").touch()
    before = (tmp_path / "b").read_text().splitlines()
    assert [line for line in before if line.startswith("frames")]
    assert list(map_flights(Work(folder=tmp_path), ["b"])) == [("b", DONE)]
    assert (tmp_path / "b").read_text().splitlines()[: len(before)] == before


def test_an_absent_scheduler_is_reported(monkeypatch):
    monkeypatch.setattr(engine, "CONNECT_S", 0.5)
    with pytest.raises(BadInputError, match="no Dask scheduler answers"):
        list(map_flights(Work(folder=Path()), NAMES, "tcp://127.0.0.1:9"))


def test_without_dask(monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "_has_dask", lambda: False)
    assert len(list(map_flights(Work(folder=tmp_path), NAMES, LOCAL))) == 3
    with pytest.raises(BadInputError, match=r"plume-locate\[cluster\]"):
        list(map_flights(Work(folder=tmp_path), NAMES, "tcp://127.0.0.1:9"))
