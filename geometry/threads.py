"""One thread for linear algebra and images: sums in one order, and no idle threads that spin."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import cv2
from threadpoolctl import threadpool_limits

Given = ParamSpec("Given")
Result = TypeVar("Result")


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
