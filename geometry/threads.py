"""One thread within linear algebra and images, and threads of our own beside each other."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import ParamSpec, TypeVar

import cv2
from threadpoolctl import threadpool_limits

Given = ParamSpec("Given")
Result = TypeVar("Result")
Other = TypeVar("Other")
Item = TypeVar("Item")


def with_one_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, with BLAS and OpenCV held to one thread while it runs.

    BLAS splits a sum among its threads, so their number changes the last digits of the result, and
    iterations and thresholds enlarge that. OpenCV's results do not depend on its threads, but
    between two calls these spin, which costs CPU time. Our matrices and most of our images are
    small; frames are measured by processes side by side.
    COLMAP is given one thread where its results depend on them.
    """

    @wraps(function)
    def run_limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            with threadpool_limits(limits=1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            cv2.setNumThreads(threads)

    return run_limited


def call_both(
    jobs: int, first: Callable[[], Result], second: Callable[[], Other]
) -> tuple[Result, Other]:
    """What two functions return, called at the same time where there are several jobs.

    For work of COLMAP and OpenCV, which leaves Python to other threads meanwhile.
    """
    if jobs < 2:
        return first(), second()
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(second)
        return first(), other.result()


def map_by_threads(
    jobs: int, function: Callable[[Item], Result], items: Iterable[Item]
) -> Iterator[Result]:
    """What a function returns for each item, in order, by so many threads; see `call_both`."""
    if jobs < 2:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(function, items)
