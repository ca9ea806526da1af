"""One thread for linear algebra: sums come in one order, whatever the machine has to do."""

from threadpoolctl import threadpool_limits


def single_blas_thread() -> threadpool_limits:
    """A context manager in which every BLAS library that is loaded uses one thread.

    BLAS splits a sum among its threads, so their number changes the last digits. The matrices here
    are small: one thread is as fast. It holds for the whole process until the context is left, or
    for good where it is never entered.
    """
    return threadpool_limits(limits=1, user_api="blas")
