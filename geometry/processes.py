"""Work in a process of its own: a library that ends that process does not end this one.

A process of `multiprocessing` would run the user's own program again, which need not be written
for that; so these run Python alone, each with a pipe that only its two ends can write to.
"""

import ctypes
import os
import re
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import IO, Any, Generic, Self, TypeVar

from geometry.errors import LocateError
from geometry.memory import keep_freed_memory
from geometry.reports import Report
from geometry.threads import with_one_thread

PROGRAM = f"from {__name__} import answer_call; answer_call()"
LAST_WORDS = re.compile(r"what\(\): *(?:\[[^]]*\] *)?(.*)")
"""What C++ prints of an exception that ends a process, and COLMAP's place in its source."""
SIGNAL_AT_PARENTS_END = 1
"""PR_SET_PDEATHSIG of Linux's prctl."""
Result = TypeVar("Result")


def count_cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start_python(program: str, pipe: Connection, **options: Any) -> "subprocess.Popen[bytes]":
    """Starts another Python, of the same modules, whose argument is the descriptor of its pipe.

    Args:
        program: Its text.
        pipe: Its end of the pipe; the caller closes it.
        options: Of `subprocess.Popen`.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-c", program, str(pipe.fileno())],
        pass_fds=[pipe.fileno()],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        **options,
    )


class CallProcess(Generic[Result]):
    """Another Python that makes one call, and ends with the block.

    It imports the module of the function while the arguments are not known yet.

    Args:
        function: Importable by its name. It takes `progress`, which sends what it is given back.
        name: What the function does, for people.

    Raises:
        OSError: The process cannot be started.
    """

    def __init__(self, function: Callable[..., Result], *, name: str) -> None:
        self.function, self._name = function, name
        with ExitStack() as opened:
            self._printed = opened.enter_context(tempfile.TemporaryFile())
            self._pipe, theirs = Pipe()
            opened.enter_context(self._pipe)
            with theirs:
                printed = self._printed
                self._process = start_python(PROGRAM, theirs, stdout=printed, stderr=printed)
            opened.callback(self._process.wait)
            opened.callback(self._process.kill)
            with suppress(ConnectionError):  # of a process that has ended; `call` says how
                self._pipe.send((os.getpid(), function))
            self._opened = opened.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def has_ended(self) -> bool:
        """Whether the process is there no more."""
        return self._process.poll() is not None

    def call(self, *arguments: Any, report: Report, **keywords: Any) -> Callable[[], Result]:
        """Makes the call; what is returned waits for its result.

        Args:
            arguments: Of the function; they and its result are sent by pickle.
            report: Takes the progress, while the result is waited for.
            keywords: Of the function, by name.

        Raises:
            ChildProcessError: The process was ended, as a library does that aborts; by what is
                returned too, which raises what the function raises, with its traceback as a note.
        """
        with self._end_described():
            self._pipe.send((arguments, keywords))

        def wait() -> Result:
            with self._end_described():
                while True:
                    is_result, answer = self._pipe.recv()
                    if is_result:
                        break
                    report(*answer)
            if isinstance(answer, BaseException):
                raise answer
            result: Result = answer
            return result

        return wait

    def close(self) -> None:
        """Ends the process, whatever it does."""
        self._opened.close()

    @contextmanager
    def _end_described(self) -> Iterator[None]:
        """Says how the process ended where its pipe is found closed."""
        try:
            yield
        except (EOFError, ConnectionError) as error:
            end = _describe_end(self._process.wait(), self._printed)
            raise ChildProcessError(f"{self._name} {end}") from error


class ProcessesAhead:
    """Processes that are started before they are needed; those not taken end with the block."""

    def __init__(self) -> None:
        self._waiting: list[CallProcess[Any]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        while self._waiting:
            self._waiting.pop().close()

    def expect(self, function: Callable[..., Any], *, name: str) -> None:
        """Starts a process for a call that is expected; without effect where none can be started.

        Args:
            function: As of `CallProcess`.
            name: Likewise.
        """
        with suppress(OSError):
            self._waiting.append(CallProcess(function, name=name))

    def take(self, function: Callable[..., Result], *, name: str) -> CallProcess[Result]:
        """A process for one call of a function, a waiting one if there is any.

        Args:
            function: As of `CallProcess`.
            name: Likewise.

        Raises:
            OSError: The process cannot be started.
        """
        for process in self._waiting:
            if process.function is function and not process.has_ended:
                self._waiting.remove(process)
                return process
        return CallProcess(function, name=name)


def call_apart(
    function: Callable[..., Result],
    *arguments: Any,
    name: str,
    report: Report,
    ahead: ProcessesAhead | None = None,
    **keywords: Any,
) -> Result:
    """Calls a function in another process, which ends with this one.

    Args:
        function: As of `CallProcess`.
        arguments: Of the function; they and its result are sent by pickle.
        name: What it does, for people.
        report: Takes the progress.
        ahead: Processes one of which may wait for this call.
        keywords: Of the function, by name.

    Raises:
        ChildProcessError: The process was ended, as a library does that aborts.
        Exception: What the function raises, with its traceback as a note.
    """
    with (ahead or ProcessesAhead()).take(function, name=name) as process:
        return process.call(*arguments, report=report, **keywords)()


def _describe_end(code: int, printed: IO[bytes]) -> str:
    printed.seek(0)
    words = LAST_WORDS.search(printed.read().decode(errors="replace"))
    how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
    return f"{how} ({words[1]})" if words else how


@with_one_thread
def answer_call() -> None:
    """Runs such a process: makes the one call it is sent, and sends what came of it."""
    keep_freed_memory()
    with Connection(int(sys.argv[1])) as pipe:
        parent, function = pipe.recv()
        _end_with(parent)
        arguments, keywords = pipe.recv()
        try:
            answer = function(
                *arguments, progress=lambda *done: pipe.send((False, done)), **keywords
            )
        except (LocateError, OSError, MemoryError) as error:
            answer = error
        except Exception as error:
            answer = RuntimeError(str(error))
            answer.add_note(traceback.format_exc())
        pipe.send((True, answer))


def _end_with(parent: int) -> None:
    """Asks Linux to end this process when its parent ends, however that is ended."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SIGNAL_AT_PARENTS_END, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit()
