"""The benchmark of growth fits exponents, and shrinks films, as it says."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.growth import growth_rows
from benchmarks.growth.picture import HEIGHT, WIDTH, panel
from benchmarks.growth.sizes import write_shrunk
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.writer import LOSSLESS, create_video
from locate.simulation.evidence import orbit_trajectory

SIZES = [1, 2, 4]


def test_exponents_are_those_of_power_laws() -> None:
    costs = [{"CPU s": 3.0 * n**2, "MiB": 200.0, "idle": 0.0} for n in SIZES]
    rows = growth_rows("things", SIZES, costs, [{"found": str(n)} for n in SIZES])
    assert [row["things"] for row in rows] == ["1", "2", "4", "exponent"]
    assert rows[-1] == {
        "things": "exponent", "found": "", "CPU s": "2.00", "MiB": "0.00", "idle": "-",
    }  # fmt: skip
    assert len({tuple(row) for row in rows}) == 1


def test_a_cost_that_a_size_lacks_is_none_and_one_size_has_no_exponent() -> None:
    rows = growth_rows("things", SIZES[:1], [{"CPU s": 1.5}])
    assert rows == [{"things": "1", "CPU s": "1.50"}]
    rows = growth_rows("things", SIZES[:2], [{"CPU s": 1.5}, {"CPU s": 3.0, "again": 1.0}])
    assert [row["again"] for row in rows] == ["0", "1", "-"]


def test_a_shrunk_film_has_the_means_of_its_pixels(tmp_path: Path) -> None:
    truth = orbit_trajectory(5, 20.0)
    truth.save(tmp_path / "truth.json")
    large = np.random.default_rng(0).integers(0, 256, (240, 320)).astype(np.uint8)
    with create_video(tmp_path / "film.mkv", size=(320, 240), fps=5, codec=LOSSLESS) as film:
        for _ in range(len(truth)):
            film.write(large)
    (tmp_path / "small").mkdir()
    video, size = write_shrunk(tmp_path, tmp_path / "small", 80)
    frames = list(open_recording(video, max_side=ANY_SIDE).frames())
    assert size == (80, 60)
    assert len(frames) == len(truth)
    assert frames[1].time_s - frames[0].time_s == pytest.approx(0.2, abs=1e-3)
    means = large.reshape(60, 4, 80, 4).mean(axis=(1, 3))
    assert np.abs(frames[0].image - means).max() <= 0.5


def test_a_panel_draws_what_grows_linearly_along_the_grey_line() -> None:
    grows, stays = (
        panel(growth_rows("things", SIZES, [{"CPU s": cost} for cost in costs]))
        for costs in ([1.0, 2.0, 4.0], [1.0, 1.0, 1.0])
    )
    grey = [int((image == 200).all(axis=2).sum()) for image in (grows, stays)]
    assert grows.shape == (HEIGHT, WIDTH, 3)
    assert grey[0] < grey[1] / 2
