"""Tests of `geometry.threads`: one thread within libraries, and threads beside each other."""

from collections.abc import Iterator
from threading import Barrier

import cv2
import pytest
from threadpoolctl import threadpool_info

from geometry.threads import call_both, map_by_threads, with_one_thread


@pytest.fixture
def two_opencv_threads() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    yield
    cv2.setNumThreads(before)


@with_one_thread
def count_threads() -> set[int]:
    blas = {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}
    return {cv2.getNumThreads(), *blas}


@with_one_thread
def fail() -> None:
    raise ValueError("as asked")


@pytest.mark.usefixtures("two_opencv_threads")
def test_blas_and_opencv_have_one_thread_inside() -> None:
    assert count_threads() == {1}


@pytest.mark.usefixtures("two_opencv_threads")
def test_opencv_has_its_threads_again_afterwards() -> None:
    count_threads()
    with pytest.raises(ValueError, match="as asked"):
        fail()
    assert cv2.getNumThreads() == 2


def test_two_jobs_work_at_the_same_time_and_keep_their_order() -> None:
    both = Barrier(2)
    first, second = call_both(2, lambda: both.wait(timeout=30), lambda: both.wait(timeout=30))
    assert {first, second} == {0, 1}

    def meet(item: int) -> int:
        both.wait(timeout=30)
        return 10 * item

    assert list(map_by_threads(2, meet, range(6))) == [0, 10, 20, 30, 40, 50]


def test_one_job_takes_one_after_the_other() -> None:
    order: list[str] = []
    assert call_both(1, lambda: order.append("a"), lambda: order.append("b")) == (None, None)
    assert list(map_by_threads(1, order.append, "cd")) == [None, None]
    assert order == ["a", "b", "c", "d"]
