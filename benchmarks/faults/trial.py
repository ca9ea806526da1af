"""One run of a small recording, disturbed on its way, and what is left of it."""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2

from geometry.atomic import is_unfinished
from locate.cli import main
from locate.commands.app import app
from locate.fusion.search import null
from locate.pipeline.stamp import Stamp, digest_outputs
from locate.recording import open_recording
from locate.recording.sample import SAMPLE_VIDEO
from locate.recording.writer import LOSSLESS, create_video

FRAMES, WIDTH = 6, 240
OWN = (".stages", "log.jsonl", "report.html", ".lock", ".stage.lock")
"""Hold times, or nothing. Their digests are held against the stamps."""
Trouble = Callable[[], object]
LOADED = app
"""All modules are loaded before the first run is forked."""
FEW_DRAWS = 2
"""Of what chance makes of the views, in place of twelve, which take a third of such a run."""


def hurry() -> None:
    """The command line, with few draws: the maps are compared with each other only."""
    null.NULL_DRAWS = FEW_DRAWS
    main()


def write_recording(path: Path) -> None:
    """The bundled sample, small: structure from motion and everything after it take 3 CPU s."""
    images = [frame.image for frame in open_recording(SAMPLE_VIDEO).frames()]
    height = images[0].shape[0] * WIDTH // images[0].shape[1]
    with create_video(path, size=(WIDTH, height), fps=2.0, codec=LOSSLESS) as video:
        for image in images[:: len(images) // FRAMES]:
            video.write(cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA))


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a run ended.

    Attributes:
        code: Its exit code, or minus the signal that ended it.
        said: What it printed.
    """

    code: int
    said: str

    @property
    def is_refusal(self) -> bool:
        """Whether it was ended by one line that says why."""
        lines = [line for line in self.said.splitlines() if line.strip()]
        return self.code == 2 and lines[-1].startswith("locate: ") and "Traceback" not in self.said

    def __str__(self) -> str:
        return f"exit code {self.code}, {' '.join(self.said.split())[-300:]!r}"


class DisturbedRun:
    """A run in a process of its own, which has begun.

    Args:
        recording: Of `write_recording`.
        output: The run folder.
        trouble: Called in that process before the run begins.
    """

    def __init__(self, recording: Path, output: Path, trouble: Trouble = bool) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `end`
        sys.stdout.flush()
        self._pid = os.fork()
        if not self._pid:
            self._run(["locate", "run", str(recording), "-o", str(output)], trouble)

    def _run(self, command: list[str], trouble: Trouble) -> None:
        code = 1
        try:
            for stream in (1, 2):
                os.dup2(self._said.fileno(), stream)
            sys.argv = command
            trouble()
            hurry()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(bool(end.code))
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            sys.stderr.flush()
            os._exit(code)

    def end(self) -> Ending:
        """Waits until it has ended."""
        code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        with self._said as file:
            file.seek(0)
            return Ending(code=code, said=file.read().decode(errors="replace"))


@dataclass(frozen=True, kw_only=True)
class Whole:
    """The run that nothing disturbed, with which the others are compared.

    Attributes:
        recording: The video.
        folder: Its run folder.
        seconds: How long it took.
    """

    recording: Path
    folder: Path
    seconds: float

    @classmethod
    def make(cls, work: Path) -> "Whole":
        """Films and runs.

        Raises:
            RuntimeError: The run did not end well.
        """
        recording, folder = work / "recording.mkv", work / "whole"
        write_recording(recording)
        started_s = time.monotonic()
        ending = DisturbedRun(recording, folder).end()
        if ending.code:
            raise RuntimeError(str(ending))
        return cls(recording=recording, folder=folder, seconds=time.monotonic() - started_s)

    def run(self, output: Path, trouble: Trouble = bool) -> Ending:
        """Runs once, to the end or to the trouble."""
        return DisturbedRun(self.recording, output, trouble).end()

    def resume(self, output: Path) -> str:
        """Gives the command once more; empty where the folder then is as this one, else why not."""
        ending = self.run(output)
        return str(ending) if ending.code else self.find_difference(output)

    def find_difference(self, output: Path) -> str:
        """The first thing in which the results in a folder differ from these; empty where none."""
        mine, theirs = results_of(self.folder), results_of(output)
        for name in sorted(mine.keys() | theirs.keys()):
            if mine.get(name) != theirs.get(name):
                return f"{name} differs"
        for path in (self.folder / ".stages").iterdir():
            stamp = Stamp.load(output / ".stages" / path.name)
            damaged = "it" if stamp is None else stamp.find_damage(output)
            if damaged is not None:
                return f"the stamp {path.name} does not fit {damaged}"
        left = [path for path in output.rglob("*") if is_unfinished(path)]
        return f"{left[0]} was left" if left or any((output / ".partial").iterdir()) else ""


def results_of(folder: Path) -> dict[str, object]:
    """Digests of all files but those that hold times."""
    found = digest_outputs(folder)
    return {name: known for name, known in found.items() if name.split("/")[0] not in OWN}
