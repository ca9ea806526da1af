"""Every test of hostile files runs in limited memory."""

from collections.abc import Iterator

import pytest

from tests.fuzz.bounds import memory_limited


@pytest.fixture(autouse=True)
def limited_memory() -> Iterator[None]:
    with memory_limited():
        yield
