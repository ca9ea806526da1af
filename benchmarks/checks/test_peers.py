"""The peers are honest, the bounds are bounds, and a worse ratio is seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.bounds.displacement import displacement_bound
from benchmarks.bounds.source import draw, source_bound
from benchmarks.common.csv_tables import Row, read_table, write_table
from benchmarks.common.turns import costs_of
from benchmarks.peers.blobs import Blobs
from benchmarks.peers.compare import losses_of
from benchmarks.peers.particle_filter import filter_particles
from benchmarks.peers.triangulation import triangulate_marks
from benchmarks.peers.visual_hull import carve
from detect.differential import LeastSquaresWindow
from locate.fusion.views import Views
from locate.simulation.evidence import NO_FAULTS, ColumnTruth, EvidenceFaults


@pytest.fixture(scope="module")
def drawn() -> tuple[ColumnTruth, Views]:
    return draw(6300, NO_FAULTS)


def test_peers_find_the_source_of_exact_masks(drawn: tuple[ColumnTruth, Views]) -> None:
    truth, views = drawn
    blobs, box = Blobs.of(views), views.volume()
    rng = np.random.default_rng(0)
    found = {
        "marks": triangulate_marks(blobs.trajectory, blobs.lowest),
        "hull": carve(blobs, box),
        "particles": filter_particles(blobs.trajectory, blobs.lowest, box, rng),
    }
    errors = {name: np.linalg.norm(one.source - truth.source) for name, one in found.items() if one}
    assert errors.keys() == found.keys()
    assert errors["marks"] < 0.05
    assert errors["particles"] < 0.1
    assert errors["hull"] < 2 * box.voxel


def test_without_masks_peers_say_nothing(drawn: tuple[ColumnTruth, Views]) -> None:
    _, views = drawn
    blobs = Blobs.of(replace(views, llr=np.zeros_like(views.llr)))
    box, rng = views.volume(), np.random.default_rng(0)
    assert triangulate_marks(blobs.trajectory, blobs.lowest) is None
    assert carve(blobs, box) is None
    assert filter_particles(blobs.trajectory, blobs.lowest, box, rng) is None


def test_errors_of_marks_reach_the_bound_of_their_rays() -> None:
    faults = EvidenceFaults(flipped_pixels=0, missed_views=0, false_blobs=0)
    truth, views = draw(6301, faults)
    camera, poses = views.trajectory.camera, views.trajectory
    rng = np.random.default_rng(0)
    exact = np.array([poses.project(i, truth.source[None])[0] for i in range(len(views))])
    bound = source_bound(views, truth, replace(faults, position_sigma_m=0, rotation_sigma_deg=0))
    errors = []
    for _ in range(40):
        marks = exact + rng.normal(0, np.sqrt(1 / 12), exact.shape)
        found = triangulate_marks(poses, marks)
        assert found is not None
        errors.append(found.source - truth.source)
    assert camera.width == 320
    assert (np.array(errors) ** 2).sum(axis=1).mean() == pytest.approx(np.trace(bound), rel=0.35)


def test_a_window_of_least_squares_reaches_its_bound() -> None:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:160, :160].astype(np.float32)
    image = 120 + 40 * np.sin(0.5 * x) + 40 * np.sin(0.5 * y)
    gx, gy = (20 * np.cos(0.5 * along).astype(np.float32) for along in (x, y))
    window = LeastSquaresWindow(gx, gy, 4.0, 0.0)
    noise = rng.normal(0, 1, image.shape).astype(np.float32)
    inside = slice(20, -20)
    errors = (window.solve_shift(noise)[inside, inside] ** 2).sum(axis=-1).mean()
    bound = displacement_bound(np.rint(image).astype(np.uint8), 4.0, 1.0)
    assert errors == pytest.approx(bound[inside, inside].mean(), rel=0.15)


def test_ratios_are_taken_within_a_round() -> None:
    spent = {"ours": np.array([1.0, 2.0, 4.0]), "theirs": np.array([2.0, 4.0, 12.0])}
    costs = costs_of(spent)
    assert costs["ours"].of_first == 1
    assert costs["theirs"].of_first == 2
    assert costs["theirs"].cpu_s == 4


def row(name: str, ratio: float, bound: float) -> Row:
    return {
        "way": name,
        "CPU s": "1.0",
        "CPU, of ours": f"{ratio}",
        "error, of the bound": f"{bound}",
    }


def test_a_worse_ratio_is_named(tmp_path: Path) -> None:
    new, stored = tmp_path / "peers_new.csv", tmp_path / "stored.csv"
    write_table(stored, [row("a", 2.0, 1.5), row("b", 2.0, 1.5)])
    write_table(new, [row("a", 1.9, 1.6), row("c", 0.1, 9.0)])
    assert read_table(new)[0]["way"] == "a"
    assert list(losses_of(new, stored)) == []
    write_table(new, [row("a", 1.0, 3.0), row("b", 9.0, 0.5)])
    lost = list(losses_of(new, stored))
    assert len(lost) == 2
    assert all("a: " in one for one in lost)
    assert list(losses_of(new, tmp_path / "nothing.csv")) == []
