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
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import IO, Any, TypeVar

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


def call_apart(
    function: Callable[..., Result],
    *arguments: Any,
    name: str,
    report: Report,
    **keywords: Any,
) -> Result:
    """Calls a function in another process, which ends with this one.

    Args:
        function: Importable by its name. It takes `progress`, which calls `report` here.
        arguments: Of the function; they and its result are sent by pickle.
        name: What it does, for people.
        report: Takes the progress.
        keywords: Of the function, by name.

    Raises:
        ChildProcessError: The process was ended, as a library does that aborts.
        Exception: What the function raises, with its traceback as a note.
    """
    with start_call(function, *arguments, name=name, report=report, **keywords) as wait:
        return wait()


@contextmanager
def start_call(
    function: Callable[..., Result],
    *arguments: Any,
    name: str,
    report: Report,
    **keywords: Any,
) -> Iterator[Callable[[], Result]]:
    """Starts what `call_apart` does, and ends it with the block if it is not done by then.

    Yields:
        What waits for the result, and passes the progress on meanwhile.
    """
    ours, theirs = Pipe()
    with ours, tempfile.TemporaryFile() as printed:
        with theirs:
            process = start_python(PROGRAM, theirs, stdout=printed, stderr=printed)

        def wait() -> Result:
            with _end_described(process, printed, name):
                while True:
                    is_result, answer = ours.recv()
                    if is_result:
                        break
                    report(*answer)
            if isinstance(answer, BaseException):
                raise answer
            result: Result = answer
            return result

        try:
            with _end_described(process, printed, name):
                ours.send((os.getpid(), function, arguments, keywords))
            yield wait
        finally:
            process.kill()
            process.wait()


@contextmanager
def _end_described(
    process: "subprocess.Popen[bytes]", printed: IO[bytes], name: str
) -> Iterator[None]:
    """Says how the process ended where its pipe is found closed."""
    try:
        yield
    except (EOFError, ConnectionError) as error:
        raise ChildProcessError(f"{name} {_describe_end(process.wait(), printed)}") from error


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
        parent, function, arguments, keywords = pipe.recv()
        _end_with(parent)
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
