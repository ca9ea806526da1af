"""The benchmark of stated probabilities counts what it says."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.reliability.answers import TruePlume, axis_of
from benchmarks.reliability.outcomes import (
    Candidate,
    RecordingOutcome,
    Share,
    StatedPlume,
    binned,
    calibration_error,
)
from benchmarks.reliability.picture import picture, row
from benchmarks.reliability.recordings import (
    CONDITIONS,
    FLOWS,
    SEEDS,
    capture_of,
    condition_of,
    flow_of,
    is_held_out,
    leak_of,
)
from benchmarks.reliability.tables import fitted, found_over_limit, report
from benchmarks.survey.sightings import plume_at
from detect.calibration import fit_logistic
from detect.synthesis.split import split_of_photo
from geometry.arrays import FloatArray
from locate.fusion.matched.probability import OFFSET, PER_LOG_NAT, PER_SIGMA
from locate.simulation.evidence import orbit_trajectory
from locate.simulation.scene import PlumeSpec

NEAR, FAR = 0.1, 0.3


def stated(off: float, error: float = 0.02) -> StatedPlume:
    return StatedPlume(probability=0.97, off=off, error=error, nees=3.0)


def candidate(off: float, sigmas: float = 11.0) -> Candidate:
    return Candidate(sigmas=sigmas, nats_per_view=6.0, off=off)


@pytest.fixture
def outcome() -> RecordingOutcome:
    return RecordingOutcome(
        condition="coded",
        held_out=True,
        amplitude_px=0.3,
        strength_px=0.2,
        limit_px=0.1,
        candidates=(candidate(NEAR), candidate(FAR, 6.0)),
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


def test_of_nothing_all_is_possible() -> None:
    assert Share.of([]).interval == (0, 1)


def test_bins_hold_their_upper_edge() -> None:
    probabilities = [0, 0.2, 0.3, 0.5, 0.95, 0.951, 1]
    bins = binned(probabilities, [False, True, True, False, True, True, True])
    assert [each.true.count for each in bins] == [2, 2, 0, 1, 2]
    assert [each.true.hits for each in bins] == [1, 1, 0, 1, 2]
    assert bins[1].stated == pytest.approx(0.4)
    assert np.isnan(bins[2].stated)


def test_the_calibration_error_weighs_bins_by_their_size() -> None:
    bins = binned([0.1, 0.1, 0.9], [False, False, False])
    assert calibration_error(bins) == pytest.approx((2 * 0.1 + 0.9) / 3)


def test_a_plume_stated_as_two_is_true_once(outcome: RecordingOutcome) -> None:
    twice = replace(outcome, plumes=(stated(NEAR), stated(NEAR / 2), stated(FAR)))
    assert twice.truths == [False, True, False]
    assert twice.found == stated(NEAR / 2)


def test_a_plume_elsewhere_is_not_found(outcome: RecordingOutcome) -> None:
    elsewhere = replace(outcome, plumes=(stated(FAR),))
    assert elsewhere.found is None
    assert elsewhere.truths == [False]


def test_without_a_plume_nothing_is_true(outcome: RecordingOutcome) -> None:
    empty = replace(outcome, amplitude_px=0.0)
    assert empty.truths == [False]
    assert not empty.is_true(candidate(NEAR))
    assert "| coded | 0 of 0 (0 to 100 %) | 1 of 1 (3 to 100 %) | 0 of 1" in report([empty])


def test_the_surest_column_counts(outcome: RecordingOutcome) -> None:
    assert outcome.surest == candidate(NEAR)
    assert "| 0.95 to 1 | 0.995 | 1 of 1" in report([outcome])
    assert replace(outcome, candidates=()).surest is None


def test_what_lies_over_the_limit(outcome: RecordingOutcome) -> None:
    weak = replace(outcome, strength_px=0.06, plumes=())
    unknown = replace(outcome, limit_px=None)
    shares = found_over_limit([outcome, weak, unknown, replace(outcome, amplitude_px=0.0)])
    counts = [(share.hits, share.count) for _, _, share in shares]
    assert counts == [(0, 0), (0, 1), (0, 0), (1, 1), (0, 0)]
    assert "no limit is stated: 1 of 1" in report([unknown])


def test_the_fit_recovers_the_curve_that_drew_the_labels(outcome: RecordingOutcome) -> None:
    rng = np.random.default_rng(0)
    every = []
    for _ in range(12000):
        column = Candidate(
            sigmas=rng.uniform(4, 12), nats_per_view=rng.uniform(0, 20), off=float(NEAR)
        )
        right = rng.random() < column.probability
        drawn = replace(column, off=NEAR if right else FAR)
        every.append(replace(outcome, held_out=False, candidates=(drawn,)))
    found = [float(number) for number in re.findall(r"-?\d+\.\d+", fitted(every))]
    assert found == pytest.approx([OFFSET, PER_SIGMA, PER_LOG_NAT], rel=0.15)


def test_outcomes_are_kept(outcome: RecordingOutcome, tmp_path: Path) -> None:
    for one in (outcome, replace(outcome, limit_px=None, candidates=(candidate(np.inf),))):
        one.save(tmp_path / "1.json")
        assert RecordingOutcome.load(tmp_path / "1.json") == one


def test_picture_shows_the_share_where_it_is(outcome: RecordingOutcome) -> None:
    empty = replace(outcome, amplitude_px=0.0)
    half = picture([outcome, empty])[row(0.5), :400]
    assert (half == (200, 120, 30)).all(axis=1).any()
    assert (picture([outcome])[row(0.5), :400] == (200, 120, 30)).all(axis=1).sum() <= 1


def test_conditions_and_flows_cross() -> None:
    cells = Counter((flow_of(seed), condition_of(seed)) for seed in SEEDS)
    assert len(cells) == FLOWS * len(CONDITIONS)
    assert len(set(cells.values())) == 1
    held = [seed for seed in SEEDS if is_held_out(seed)]
    rest = [seed for seed in SEEDS if not is_held_out(seed)]
    assert len(rest) >= 200
    assert not set(map(flow_of, held)) & set(map(flow_of, rest))


def test_recordings_share_flows_and_nothing_else(tmp_path: Path) -> None:
    for number in range(150):
        (tmp_path / f"{number}.png").touch()
    first, second = SEEDS.start, SEEDS.start + FLOWS
    exits = [(p.flow_seed, p.radius_m, p.height_m) for p in map(leak_of, (first, second))]
    assert exits[0] == exits[1]
    captures = [capture_of(seed, tmp_path) for seed in (first, second)]
    assert captures[0].scene.path != captures[1].scene.path
    assert captures[0].coding is None
    assert captures[1].coding is not None
    held = capture_of(SEEDS.start + 2, tmp_path)
    assert {split_of_photo(photo) for photo in held.photos} == {"test"}
    assert {split_of_photo(photo) for c in captures for photo in c.photos} == {"train"}


def leak_at(source: FloatArray, height_m: float) -> PlumeSpec:
    return PlumeSpec(source=tuple(source.tolist()), height_m=height_m, amplitude_px=0.3)


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
