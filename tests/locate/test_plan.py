"""What is planned, against plume theory."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from geometry.errors import BadInputError
from geometry.refraction import density_deficit
from geometry.rising_plume import RisingPlume
from locate.commands.app import app
from locate.planning.plan import Coding, Plan, PlannedSource, PlannedView


def methane_leak(rate_kgps: float) -> RisingPlume:
    return RisingPlume.of_leak(rate_kgps, gas="methane", mole_fraction=1.0, temperature_k=288.0)


def test_a_leak_keeps_its_buoyancy_on_the_way_up() -> None:
    """Fischer et al.: the mean flow carries most of it past each height, its eddies a fifth."""
    plume = methane_leak(0.005)
    reduced = 9.81 * density_deficit("methane", 1.0, 288.0)
    volume = 0.005 / (16.04e-3 * 101325 / (8.314 * 288.0))
    height_m = 3.0
    from_origin_m = height_m + plume.radius_m / plume.spread
    speed_mps = 4.7 * (reduced * volume / from_origin_m) ** (1 / 3)
    speed_width_m, share_width_m = 0.100 * from_origin_m, 0.120 * from_origin_m
    overlap = 1 / (1 / speed_width_m**2 + 1 / share_width_m**2)
    carried = np.pi * overlap * speed_mps * reduced * float(plume.share_at(height_m))
    assert 0.75 < carried / (reduced * volume) < 0.85


def test_a_leak_of_more_is_wider_and_is_seen_from_farther() -> None:
    small, large = methane_leak(0.001), methane_leak(0.01)
    assert large.radius_m == pytest.approx(10 ** (2 / 5) * small.radius_m)
    assert float(large.share_at(1.0)) > float(small.share_at(1.0))


def test_a_leak_that_weighs_what_air_does_is_refused() -> None:
    with pytest.raises(BadInputError, match="give the radius of its source"):
        RisingPlume.of_leak(0.001, gas="air", mole_fraction=1.0, temperature_k=288.0)


def plan_at(range_m: float, *, coding: Coding = "lossless") -> Plan:
    source = PlannedSource(temperature_k=588.0, plume=RisingPlume.of_source(0.12))
    view = PlannedView.of_camera(
        (1920, 1080),
        focal_px=None,
        fov_deg=60.0,
        max_side=1280,
        range_to_plume_m=range_m,
        range_to_background_m=range_m + 6,
    )
    return Plan(source=source, view=view, coding=coding)


def test_frames_are_reduced_as_a_run_reduces_them() -> None:
    view = plan_at(6.0).view
    assert (view.width, view.height) == (1280, 720)
    assert view.focal_px == pytest.approx(640 / np.tan(np.radians(30)))


def test_what_is_weaker_takes_more_frames_until_it_is_too_weak() -> None:
    near, coded, far = plan_at(6.0), plan_at(6.0, coding="video"), plan_at(40.0, coding="video")
    assert near.measured_frames == 16
    assert coded.measured_frames == int(np.ceil(16 * (0.3 / coded.strength_px) ** 2))
    assert far.measured_frames is None
    assert near.at_range(40.0).strength_px == pytest.approx(far.strength_px)


def typed(folder: Path, *arguments: object) -> Result:
    usual = ("--to-plume", 8, "--to-background", 15, "-o", folder / "plan.png")
    return CliRunner().invoke(app, ["plan", *map(str, (*usual, *arguments))])


def test_the_command_prints_a_table_and_draws_a_picture(tmp_path: Path) -> None:
    result = typed(tmp_path, "--gas", "methane", "--leak", 5, "--fov", 65)
    assert result.exit_code == 0, result.output
    assert "1280x720 px, focal length 1005 px" in result.output
    assert "0.083 px" in result.output
    assert "0.9 to 2 times that" in result.output
    picture = cv2.imread(str(tmp_path / "plan.png"))
    assert picture is not None
    assert picture.shape == (560, 900, 3)
    assert (picture == (180, 119, 31)).all(axis=-1).sum() > 300


@pytest.mark.parametrize(
    "arguments",
    [
        ("--radius", "inf", "--focal", 1000),
        ("--radius", "1e308", "--focal", 1000),
        ("--radius", 1, "--focal", "inf"),
        ("--radius", 1, "--focal", "1e308"),
        ("--radius", 1, "--focal", 1000, "--to-background", "inf"),
    ],
)
def test_what_is_too_large_is_refused(tmp_path: Path, arguments: tuple[object, ...]) -> None:
    result = typed(tmp_path, "--gas", "methane", *arguments)
    assert result.exit_code == 2
    assert "Invalid value" in result.output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--gas", "methane", "--fov", 65), "either --leak"),
        (("--gas", "methane", "--leak", 1, "--radius", 1, "--fov", 65), "either --leak"),
        (("--leak", 1, "--fov", 65), "give --rise or --gas"),
        (("--gas", "methane", "--leak", 1), "either --focal"),
        (("--gas", "methane", "--leak", 1, "--fov", 65, "--size", "4k"), "such as 1920x1080"),
        (("--gas", "methane", "--leak", 1, "--fov", 65, "--to-background", 5), "behind the plume"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, arguments: tuple[object, ...], says: str) -> None:
    result = typed(tmp_path, *arguments)
    assert isinstance(result.exception, BadInputError)
    assert says in str(result.exception)
