"""Fixtures that every floor uses."""

from pathlib import Path

import pytest


@pytest.fixture
def shared_data() -> Path:
    """The folder of real recordings, which is no part of the repository."""
    folder = Path(__file__).parents[1] / "../shared/data"
    if not folder.is_dir():
        pytest.skip(f"the real recordings are not here ({folder.resolve()})")
    return folder.resolve()
