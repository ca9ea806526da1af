"""One thread while a function runs, and as many as before when it is done."""

from collections.abc import Iterator

import cv2
import pytest
from threadpoolctl import threadpool_info

from geometry.threads import with_one_thread


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
