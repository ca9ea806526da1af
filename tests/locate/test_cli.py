"""How a command ends: interrupted at any moment, or by an error of the system."""

import errno
import json
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from geometry.errors import INTERRUPTED, BadInputError, InterruptedRunError
from locate import cli
from locate.commands.app import app
from locate.journal.progress import SIGNALS, interruptible
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO

SIGNALLED_AT_AN_IMPORT = """
import os, signal, sys
import locate.cli

MODULE, NUMBER = sys.argv[1], int(sys.argv[2])
del sys.argv[1:3]

class Signaller:
    def find_spec(self, name, path=None, target=None):
        if name == MODULE:
            os.kill(os.getpid(), NUMBER)

sys.meta_path.insert(0, Signaller())
signal.signal(signal.SIGINT, signal.default_int_handler)
locate.cli.main()
"""


@pytest.fixture(autouse=True)
def handlers_as_before() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("how", SIGNALS)
@pytest.mark.parametrize(
    "module", ["typer", "numpy", "cv2", "scipy", "pycolmap", "locate.pipeline.run", "gtsam"]
)
def test_interrupted_while_modules_load_it_says_so_in_one_line(
    tmp_path: Path, module: str, how: signal.Signals
) -> None:
    script = tmp_path / "signalled.py"
    script.write_text(SIGNALLED_AT_AN_IMPORT)
    done = subprocess.run(
        [sys.executable, script, module, str(int(how)),
         "run", SAMPLE_VIDEO, "-o", tmp_path / "out", "--max-frames", "2"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert done.stderr.strip() == f"locate: {INTERRUPTED}"


@pytest.mark.parametrize("how", SIGNALS)
@pytest.mark.parametrize("becomes", [KeyboardInterrupt, ImportError, SystemError, SystemExit])
def test_whatever_an_interrupt_becomes_it_is_one_line(
    how: signal.Signals, becomes: type[BaseException]
) -> None:
    def work() -> None:
        try:
            signal.raise_signal(how)
        except KeyboardInterrupt:
            raise becomes from None

    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(InterruptedRunError, match="goes on from here"), interruptible():
        work()


def test_an_error_without_a_signal_stays_what_it_is() -> None:
    with pytest.raises(BadInputError), interruptible():
        raise BadInputError


def test_the_import_of_pycolmap_leaves_the_answer_to_sigterm() -> None:
    with pytest.raises(InterruptedRunError), interruptible():
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        *(
            (OSError(number, os.strerror(number), "/there"), os.strerror(number))
            for number in (
                errno.EIO, errno.EROFS, errno.EACCES, errno.ENOSPC, errno.EDQUOT,
                errno.ENAMETOOLONG, errno.EMFILE,
            )
        ),
        (OSError("100 requested and 50 written"), "50 written"),
        (MemoryError(), "too little memory"),
        (sqlite3.OperationalError("database or disk is full"), "disk is full"),
    ],
)  # fmt: skip
def test_an_error_of_the_system_ends_in_one_line(
    error: Exception,
    text: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr("locate.commands.app.app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("locate: ")
    assert said.count("\n") == 1
    assert text in said


@pytest.mark.parametrize(
    "arguments",
    [
        "run PIPE",
        "run VIDEO --poses PIPE",
        "run VIDEO --telemetry PIPE",
        "run VIDEO -o PIPE",
        "survey VIDEO PIPE",
        "simulate PIPE",
        "evaluate PIPE --truth PIPE",
        "detect PIPE",
        "calibrate PIPE --board 9x6",
        "view PIPE",
        "doctor PIPE",
    ],
)
@pytest.mark.parametrize("device", [False, True])
def test_a_pipe_or_a_device_is_refused_and_not_waited_for(
    tmp_path: Path, arguments: str, device: bool
) -> None:
    pipe = Path("/dev/zero") if device else tmp_path / "a.mp4"
    if not device:
        os.mkfifo(pipe)
    given = {"PIPE": str(pipe), "VIDEO": str(SAMPLE_VIDEO)}
    words = [given.get(word, word) for word in arguments.split()]
    output = [] if {"-o", "evaluate", "view", "doctor"} & {*words} else ["-o", str(tmp_path / "o")]
    said = CliRunner().invoke(app, [*words, *output])
    assert isinstance(said.exception, BadInputError)
    assert f"{pipe}: a pipe or a device" in str(said.exception)
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("detect PLACE -o o --every 9999999999999999999999", "--every: 9999999999999999999999 is"),
        ("detect PLACE -o o --threshold nan", "--threshold nan: give a finite number"),
        ("run PLACE -o o --telemetry-offset inf", "--telemetry-offset inf: give a finite number"),
        ("survey PLACE -o o --wander inf", "--wander inf: give a finite number"),
        ("robot bag PLACE -o o --neighbours 9999999999999999999999", "--neighbours: 99"),
    ],
)
def test_numbers_that_nothing_can_use_are_refused(
    tmp_path: Path, arguments: str, says: str
) -> None:
    said = CliRunner().invoke(app, arguments.replace("PLACE", str(tmp_path)).split())
    assert isinstance(said.exception, BadInputError)
    assert says in str(said.exception)


def test_the_demo_says_how_much_stronger_its_leak_is_than_a_real_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("locate.commands.run._run", lambda *_given, **_named: None)
    (plume,) = json.loads((SAMPLE / "truth.json").read_text())["plumes"]
    shown = CliRunner().invoke(app, ["demo"]).stdout
    assert f"{plume['refractivity_gain']:.0f} times as much as air of 438 K" in shown
    assert CliRunner().invoke(app, ["demo", "--quiet"]).stdout == ""
