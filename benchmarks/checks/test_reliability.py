"""The benchmark of stated probabilities counts what it says."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.evidence import (
    ColumnTruth,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)
from benchmarks.reliability.answers import TruePlume, axis_of, draw_null, strongest_column
from benchmarks.reliability.outcomes import NO_COLUMN, RecordingOutcome, Share, Stated, binned
from benchmarks.reliability.picture import along, picture, row
from benchmarks.reliability.recordings import FLOWS, SEEDS, flow_of, scene_of
from benchmarks.reliability.tables import found_over_limit, log_loss, report
from benchmarks.survey.sightings import plume_at
from detect.calibration import fit_logistic
from geometry.arrays import FloatArray
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.simulation.scene import PlumeSpec

NEAR, FAR = 0.1, 0.3


def stated(off: float, probability: float = 0.9999, nats: float = 60) -> Stated:
    return Stated(nats=nats, probability=probability, off=off)


@pytest.fixture
def judged() -> RecordingOutcome:
    return RecordingOutcome(
        amplitude_px=0.3,
        strength_px=0.15,
        noise=1.0,
        views=8,
        floor_nats=40.0,
        threshold_nats=40.0,
        limit_px=0.1,
        strongest=stated(NEAR),
        unasked=stated(NEAR),
        plumes=(stated(NEAR),),
    )


@pytest.mark.parametrize(
    ("hits", "low", "high"),
    [(0, 0, 1 - 0.025**0.1), (5, 0.18709, 0.81291), (10, 0.025**0.1, 1)],
)
def test_intervals_are_exact(hits: int, low: float, high: float) -> None:
    assert Share(hits=hits, count=10).interval == pytest.approx((low, high), abs=1e-5)


def test_logistic_regression_finds_what_drew_the_labels() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 10, 4000)
    probability = 1 / (1 + np.exp(2 - 0.5 * x))
    labels = rng.random(4000) < probability
    assert fit_logistic(x[:, None], labels) == pytest.approx((0.5, -2), abs=0.3)
    assert log_loss(probability, labels) < log_loss(np.full(4000, labels.mean()), labels)


def test_of_nothing_all_is_possible() -> None:
    assert Share.of([]).interval == (0, 1)


def test_bins_hold_their_upper_edge() -> None:
    probabilities = [0, 0.5, 0.51, 0.9, 0.99, 0.9991, 1]
    bins = binned(probabilities, [False, True, True, False, True, True, True])
    assert [each.true.count for each in bins] == [2, 2, 1, 0, 2]
    assert [each.true.hits for each in bins] == [1, 1, 1, 0, 2]
    assert bins[1].stated == pytest.approx(0.705)
    assert np.isnan(bins[3].stated)


def test_a_plume_told_as_two_is_true_once(judged: RecordingOutcome) -> None:
    twice = replace(judged, plumes=(stated(NEAR), stated(NEAR / 2), stated(FAR)))
    assert twice.truths == [False, True, False]
    assert twice.found


def test_a_plume_elsewhere_is_not_found(judged: RecordingOutcome) -> None:
    elsewhere = replace(judged, plumes=(stated(FAR),), strongest=stated(FAR))
    assert not elsewhere.found
    assert not elsewhere.true(elsewhere.strongest)


def test_without_a_plume_nothing_is_true(judged: RecordingOutcome) -> None:
    empty = replace(judged, amplitude_px=0.0)
    assert empty.truths == [False]
    assert not empty.true(empty.strongest)
    assert "report one: 1 of 1" in report([empty])
    assert "would have stood: 1 of 1" in report([empty])
    rare = replace(empty, unasked=stated(FAR, probability=0.95))
    assert "| 0.1 | 2 of 2 (16 to 100 %) | 2 of 2 (16 to 100 %) |" in report([empty, rare])
    assert "| 0.01 | 2 of 2 (16 to 100 %) | 1 of 2 (1 to 99 %) |" in report([empty, rare])


def test_what_lies_over_the_limit(judged: RecordingOutcome) -> None:
    weak = replace(judged, strength_px=0.06, plumes=())
    unknown = replace(judged, limit_px=None)
    shares = found_over_limit([judged, weak, unknown, replace(judged, amplitude_px=0.0)])
    assert [(share.hits, share.count) for _, _, share in shares] == [(0, 0), (0, 1), (1, 1), (0, 0)]
    assert "| no limit stated | 1 of 1" in report([unknown])
    assert "median with a plume: limit 0.100 px, level 40 nats" in report([judged, weak, unknown])


def test_quiet_columns_are_told_apart(judged: RecordingOutcome) -> None:
    quiet = replace(judged, strongest=stated(FAR, nats=39))
    last = [line for line in report([judged, quiet]).splitlines() if line.startswith("| 0.999 ")]
    assert [cell.split(" (")[0].strip() for cell in last[0].split("|")[3:5]] == ["1 of 2", "1 of 1"]


def test_judgements_are_kept(judged: RecordingOutcome, tmp_path: Path) -> None:
    for one in (judged, replace(judged, limit_px=None, strongest=stated(np.inf))):
        one.save(tmp_path / "1.json")
        assert RecordingOutcome.load(tmp_path / "1.json") == one


def test_picture_shows_the_share_where_it_is(judged: RecordingOutcome) -> None:
    every = [judged, replace(judged, strongest=stated(FAR), plumes=())]
    image = picture(every)
    half = image[row(0.5), :400]
    assert (half == (200, 120, 30)).all(axis=1).any()
    assert not (picture([judged])[row(0.5), :400] == (200, 120, 30)).all(axis=1).sum() > 1
    assert along(0.01) == along(0.3) < along(5) < along(1000) == along(100)


def test_scenes_share_flows_and_nothing_else() -> None:
    seeds = [seed for seed in SEEDS if scene_of(seed).plumes]
    uses = Counter(flow_of(seed) for seed in seeds)
    assert len(uses) <= FLOWS
    assert max(uses.values()) <= len(SEEDS) / FLOWS
    flow = max(uses, key=uses.__getitem__)
    first, second = [scene_of(seed) for seed in seeds if flow_of(seed) == flow][:2]
    one, other = first.plumes[0], second.plumes[0]
    exits = [(p.flow_seed, p.radius_m, p.height_m, p.temperature_k) for p in (one, other)]
    assert exits[0] == exits[1]
    assert one.source != other.source
    assert first.wind_mps != second.wind_mps
    assert first.objects != second.objects


@pytest.fixture(scope="module")
def truth() -> ColumnTruth:
    return random_column(np.random.default_rng(5))


@pytest.fixture(scope="module")
def views(truth: ColumnTruth) -> Views:
    return make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(5))


def leak_at(source: FloatArray, height_m: float) -> PlumeSpec:
    return PlumeSpec(source=tuple(source.tolist()), height_m=height_m, amplitude_px=0.3)


def test_the_strongest_column_stands_at_the_plume(views: Views, truth: ColumnTruth) -> None:
    there = TruePlume.of(leak_at(truth.source, truth.height), views.trajectory)
    assert there.range_m == pytest.approx(8.5, abs=1)
    null = draw_null(views)
    column = strongest_column(views, null, there)
    assert column.near
    assert column.probability > 0.99
    beside = replace(there, column=there.column.shifted(np.array([1.0, 0.0])))
    assert 3 * column.off < strongest_column(views, null, beside).off


def test_silence_is_no_column(views: Views, truth: ColumnTruth) -> None:
    silent = replace(views, llr=np.zeros_like(views.llr))
    place = TruePlume.of(leak_at(truth.source, truth.height), views.trajectory)
    null = NullLevel.from_draws([0.0, 1.0])
    assert strongest_column(silent, null, place) == NO_COLUMN


def test_a_plume_of_the_map_is_held_against_the_truth() -> None:
    leaning = np.array([0.1, 0.0, 1.0])
    plume = replace(
        plume_at(np.array([0.3, -0.2, 0.1])),
        axis=leaning / np.linalg.norm(leaning),
        extent_low=0.1,
        extent_high=2.0,
    )
    views = orbit_trajectory(12, 60)
    column = axis_of(plume)
    top = plume.source + plume.extent_high * plume.axis
    assert column.axis_points(np.array([column.height]))[0] == pytest.approx(top)
    there = TruePlume.of(leak_at(plume.source, 3.0), views)
    beside = TruePlume.of(leak_at(plume.source - [0.5, 0, 0], 3.0), views)
    assert there.off(column) == pytest.approx(0, abs=1e-9)
    assert beside.off(column) == pytest.approx(0.5 / beside.range_m)
    assert there.stated(plume).probability == plume.probability
