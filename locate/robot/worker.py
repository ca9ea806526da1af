"""Searches and detectors in processes of their own: feeding and publishing never wait for them."""

import os
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from detect.detection import Detection, Detector, Frames
from detect.registry import make_detector
from geometry.errors import BadInputError
from geometry.processes import start_python
from geometry.threads import with_one_thread
from locate.fusion.views import Views
from locate.messages.poses import StampedPose
from locate.robot.drift import SharedError
from locate.robot.fixed_lag_smoother import FixedLagSmoother
from locate.robot.search import LocalPlumeSearch
from locate.robot.settings import LocatorSettings

WITH_REPLY, WITHOUT_REPLY = True, False
WORKERS_AVAILABLE = os.name == "posix" and bool(sys.executable)
LEARNED_DETECTOR = "registered"
"""The detector of a `Locator` that was given none."""
PROGRAM = f"from {__name__} import run_worker; run_worker()"


class SubprocessWorker:
    """An object in a process of its own; a process that dies is replaced.

    Args:
        make: Makes the object; importable by its name.
        arguments: Of `make`.
        keywords: Of `make`, by name.
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any, **keywords: Any) -> None:
        self._construction = make, arguments, keywords
        self._calling, self._closed = threading.Lock(), False
        self._start_process()

    def call_method(self, method: str, *arguments: Any) -> Any:
        """Calls a method of the object and returns its result.

        Raises:
            BadInputError: As the method does.
            RuntimeError: It failed in another way (the message holds its traceback), or its
                process died.
        """
        with self._calling:
            try:
                self._pipe.send((WITH_REPLY, method, arguments))
                answer = self._pipe.recv()
            except (EOFError, OSError) as error:
                self._end_process()
                if not self._closed:
                    self._start_process()
                name = self._construction[0].__name__
                raise RuntimeError(f"the process of {name} died") from error
        if isinstance(answer, Exception):
            raise answer
        return answer

    def send_call(self, method: str, *arguments: Any) -> None:
        """Calls a method of the object without waiting for it; a failure is not reported."""
        with self._calling, suppress(OSError):
            self._pipe.send((WITHOUT_REPLY, method, arguments))

    def close(self) -> None:
        """Ends the process, whatever it is doing, and a call that another thread waits for."""
        self._closed = True
        self._process.kill()
        with self._calling:
            self._end_process()

    def _end_process(self) -> None:
        self._process.kill()
        self._process.wait()
        self._pipe.close()

    def _start_process(self) -> None:
        """Starts the process, where the keys that interrupt the robot's program do not reach."""
        self._pipe, theirs = Pipe()
        with theirs:
            self._process = start_python(PROGRAM, theirs, process_group=0)
        self._pipe.send(self._construction)


class PlumeSearchWorker:
    """A `locate.robot.search.PlumeSearch` in another process.

    Args:
        detector: As of `LocalPlumeSearch`.
        settings: As of `LocalPlumeSearch`.
    """

    def __init__(self, detector: str, settings: LocatorSettings) -> None:
        self._search = SubprocessWorker(LocalPlumeSearch, detector, settings)

    def search_window(
        self, views: Views, poses: Sequence[StampedPose], shared: SharedError
    ) -> list[FixedLagSmoother]:
        """See `PlumeSearch`; raises as `SubprocessWorker.call_method`."""
        return list(self._search.call_method("search_window", views, poses, shared))

    def forget_window(self) -> None:
        """See `PlumeSearch`."""
        self._search.send_call("forget_window")

    def close(self) -> None:
        """See `PlumeSearch`."""
        self._search.close()


class DetectorWorker:
    """The learned detector in another process; see `detect.detection.Detector`.

    Args:
        like: The same detector in this process.
        neighbours: As of `make_detector`.

    Attributes:
        name: As of a `Detector`.
        response: As of a `Detector`.
    """

    uses_other_frames = True

    def __init__(self, like: Detector, neighbours: int) -> None:
        self.name, self.response = like.name, like.response
        self._detector = SubprocessWorker(make_detector, LEARNED_DETECTOR, neighbours=neighbours)

    def detect(self, frames: Frames, index: int) -> Detection:
        """See `Detector`; raises as `SubprocessWorker.call_method`."""
        found: Detection = self._detector.call_method("detect", frames, index)
        return found

    def close(self) -> None:
        """Ends the process."""
        self._detector.close()


def serve_calls(pipe: Connection) -> None:
    """Makes the object and calls its methods until the other side is gone."""
    with suppress(EOFError, OSError):
        make, arguments, keywords = pipe.recv()
        thing = make(*arguments, **keywords)
        while True:
            reply_wanted, method, arguments = pipe.recv()
            answer = _call_safely(getattr(thing, method), arguments)
            if reply_wanted:
                pipe.send(answer)


def _call_safely(call: Callable[..., Any], arguments: Sequence[Any]) -> Any:
    """What the call returns, or what it raises."""
    try:
        return call(*arguments)
    except BadInputError as error:
        return error
    except Exception:
        return RuntimeError(traceback.format_exc())


@with_one_thread
def run_worker() -> None:
    """Runs one of these processes; its argument is the file descriptor of its pipe."""
    with Connection(int(sys.argv[1])) as pipe:
        serve_calls(pipe)
