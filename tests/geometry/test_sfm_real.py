"""Structure from motion on surveyed photos, within 1.5 times of what was measured before."""

import runpy
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bench() -> dict[str, Any]:
    return runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "sfm.py"))


def test_fountain_calibrated(shared_data: Path, tmp_path: Path, bench: dict[str, Any]) -> None:
    folder = shared_data / "2_sfm" / "strecha_fountain-P11"
    found, frames = bench["run"](folder / "images_half", tmp_path, bench["strecha_camera"](folder))
    numbers = bench["against_poses"](bench["strecha_truth"](folder))(found, frames)
    assert len(found.trajectory) == 11
    assert numbers["center_median"] < 0.0045
    assert numbers["rotation_median_deg"] < 0.06


def test_herz_jesus_uncalibrated(shared_data: Path, tmp_path: Path, bench: dict[str, Any]) -> None:
    folder = shared_data / "2_sfm" / "strecha_Herz-Jesus-P25"
    found, frames = bench["run"](folder / "images_half", tmp_path)
    numbers = bench["against_poses"](bench["strecha_truth"](folder))(found, frames)
    assert len(found.trajectory) == 25
    assert numbers["center_median"] < 0.024
    assert numbers["rotation_median_deg"] < 0.52


def test_brighton_beach_against_gps(
    shared_data: Path, tmp_path: Path, bench: dict[str, Any]
) -> None:
    folder = shared_data / "2_sfm" / "drone_brighton_beach_gps" / "images_half"
    found, frames = bench["run"](folder, tmp_path)
    assert len(found.trajectory) == 18
    assert bench["against_gps"](folder)(found, frames)["gps_residual_median_m"] < 0.53


def test_fox_walk(shared_data: Path, tmp_path: Path, bench: dict[str, Any]) -> None:
    """Exhaustive matching on this set has led global mapping 25 % of the span astray."""
    folder = shared_data / "2_sfm" / "fox_handheld"
    found, frames = bench["run"](folder / "images", tmp_path)
    truth = bench["published_truth"](folder / "transforms.json")
    numbers = bench["against_poses"](truth)(found, frames)
    assert len(found.trajectory) == 50
    assert numbers["center_share_of_span"] < 0.02
    assert numbers["rotation_median_deg"] < 0.5
