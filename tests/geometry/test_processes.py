import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from geometry import processes
from geometry.errors import BadInputError, RegistrationError, RegistrationFailure
from geometry.processes import ProcessesAhead, call_apart

HERE = str(Path(__file__).parents[2])


def double(values: np.ndarray, *, progress) -> np.ndarray:
    progress("doubling", 0.5)
    return 2 * values


def fail(error: Exception, *, progress) -> None:
    raise error


def die(code: int, *, progress) -> None:
    os.write(2, b"terminate called\n  what():  [database.cc:7] SQLite error: disk is full\n")
    if code < 0:
        os.kill(os.getpid(), -code)
    os._exit(code)


def sleep(pid_file: str, *, progress) -> None:
    Path(pid_file).write_text(str(os.getpid()))
    progress("sleeping", 0.0)
    time.sleep(3600)


def call(function, *arguments: object, report=lambda *_: None):
    return call_apart(function, *arguments, name="adding", report=report)


def test_result_and_progress_come_back() -> None:
    seen: list[tuple[str, float]] = []
    found = call(double, np.arange(3.0), report=lambda *done: seen.append(done))
    assert found.tolist() == [0.0, 2.0, 4.0]
    assert seen == [("doubling", 0.5)]


@pytest.mark.parametrize(
    "error",
    [
        BadInputError("a.png: bad"),
        RegistrationError(RegistrationFailure.PURE_ROTATION, "move sideways"),
        OSError(28, "No space left on device", "/a"),
        MemoryError(),
    ],
    ids=repr,
)
def test_what_the_function_raises_is_raised_here(error: Exception) -> None:
    with pytest.raises(type(error)) as raised:
        call(fail, error)
    assert str(raised.value) == str(error)
    assert vars(raised.value) == vars(error)


def test_a_fault_of_the_program_has_its_traceback() -> None:
    with pytest.raises(RuntimeError, match="nobody") as raised:
        call(fail, KeyError("nobody"))
    assert "in fail" in raised.value.__notes__[0]


@pytest.mark.parametrize(
    ("code", "how"), [(-signal.SIGABRT, "was ended by SIGABRT"), (3, "ended with code 3")]
)
def test_a_process_that_is_ended_is_told_in_one_line(code: int, how: str) -> None:
    with pytest.raises(ChildProcessError) as raised:
        call(die, code)
    assert str(raised.value) == f"adding {how} (SQLite error: disk is full)"


def has_ended(pid: int) -> bool:
    for _ in range(600):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.1)
    return False


def test_an_interrupt_ends_it(tmp_path: Path) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        call(sleep, str(tmp_path / "pid"), report=interrupt)
    assert has_ended(int((tmp_path / "pid").read_text()))


@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells it of its parent's end")
def test_it_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = (
        f"from {__name__} import call, sleep\n"
        f"call(sleep, {str(tmp_path / 'pid')!r}, report=lambda *_: print('sleeps', flush=True))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": HERE},
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"sleeps\n"
        parent.kill()
    assert has_ended(int((tmp_path / "pid").read_text()))


def test_a_process_that_waits_is_taken_and_the_others_end() -> None:
    with ProcessesAhead() as ahead:
        ahead.expect(double, name="doubling")
        ahead.expect(fail, name="failing")
        waiting, other = ahead._waiting
        found = call_apart(
            double, np.arange(3.0), name="doubling", report=lambda *_: None, ahead=ahead
        )
        assert found.tolist() == [0.0, 2.0, 4.0]
        assert waiting.has_ended
        assert not other.has_ended
    assert other.has_ended


def test_one_that_died_while_it_waited_is_replaced() -> None:
    with ProcessesAhead() as ahead:
        ahead.expect(double, name="doubling")
        (waiting,) = ahead._waiting
        waiting.close()
        with ahead.take(double, name="doubling") as process:
            assert process is not waiting
            assert process.call(np.ones(1), report=lambda *_: None)().tolist() == [2.0]


def test_a_function_that_cannot_be_sent_leaves_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []
    start = processes.start_python

    def start_and_keep(*given: object, **options: object) -> "subprocess.Popen[bytes]":
        started.append(start(*given, **options))
        return started[0]

    monkeypatch.setattr(processes, "start_python", start_and_keep)
    with pytest.raises((AttributeError, pickle.PicklingError)):
        processes.CallProcess(lambda progress: None, name="a lambda")
    assert started[0].poll() is not None
