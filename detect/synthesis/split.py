"""Which photos and which simulated flows are for training, validation and test."""

import hashlib
from pathlib import Path
from typing import Literal

Split = Literal["train", "validation", "test"]
VALIDATION_SHARE, TEST_SHARE = 0.1, 0.1
RUNS_IN_TURN: tuple[Split, ...] = (*("train",) * 8, "validation", "test")


def split_of_photo(path: Path) -> Split:
    """The split of a photo, by its name alone: the same in every folder and every format."""
    return split_of_name(path.stem)


def split_of_name(name: str) -> Split:
    """The split of whatever bears that name."""
    digest = hashlib.sha256(name.encode()).digest()
    place = int.from_bytes(digest[:8], "big") / 2**64
    if place < TEST_SHARE:
        return "test"
    return "validation" if place < TEST_SHARE + VALIDATION_SHARE else "train"


def split_of_run(number: int) -> Split:
    """The split of a simulation run: of each ten in turn, eight train, one validates, one tests."""
    return RUNS_IN_TURN[number % len(RUNS_IN_TURN)]
