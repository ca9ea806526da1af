"""One thread for linear algebra: sums come in one order, whatever the machine has to do."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Given = ParamSpec("Given")
Result = TypeVar("Result")


def with_one_blas_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, with every BLAS library of the process held to one thread while it runs.

    BLAS splits a sum among its threads, so their number changes the last digits of the result, and
    iterations and thresholds enlarge that. Our matrices are small: one thread is as fast. OpenCV's
    results do not depend on its threads, COLMAP is given one where they do.
    """

    @wraps(function)
    def run_limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return run_limited
