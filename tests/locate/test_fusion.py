from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import gumbel_r

from detect.detection import Detection
from detect.registry import DetectorChoice
from locate.fusion.axis.estimate import average_axes, mark_consistent
from locate.fusion.axis.graph import estimate_axis
from locate.fusion.axis.pairs import split_column
from locate.fusion.axis.sightings import AxisSightings, sight_axis
from locate.fusion.axis.sway import Sway, estimate_sway
from locate.fusion.find import cap_probability
from locate.fusion.fuse import fuse, weakest_candidate
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.null import NullLevel
from locate.fusion.search.proposals import best_interval
from locate.fusion.search.score import column_contrast, column_evidence, mask_out, score_columns
from locate.fusion.source.base import locate_base
from locate.fusion.source.measure import refine_axis
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.pipeline.map_notes import empty_frames_notes, hidden_note
from locate.simulation.evidence import (
    NO_FAULTS,
    ColumnTruth,
    EvidenceFaults,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)
from tests.locate.answers import plume as any_plume


@pytest.fixture(scope="module")
def truth() -> ColumnTruth:
    return random_column(np.random.default_rng(5))


def test_source_is_found_within_its_covariance(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(10, 60), np.random.default_rng(5))
    fused = fuse(views)
    (plume,) = fused.plumes
    error = plume.source - truth.source
    assert np.linalg.norm(error) < 0.02 * 8.5
    assert error @ np.linalg.solve(plume.source_covariance, error) < 16
    assert np.degrees(np.arccos(plume.axis @ truth.axis)) < 8
    assert plume.probability > 0.99


def test_the_level_is_drawn_without_the_plume_that_was_found(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(10, 60), np.random.default_rng(5))
    with_the_plume = NullLevel.from_views(
        views, views.volume(), np.random.default_rng(0), progress=lambda _: None
    )
    levels = [fuse(views, seed=seed).threshold_nats for seed in range(3)]
    assert np.median(levels) < 0.8 * with_the_plume.threshold(0.01)


def test_a_floor_far_above_chance_ends_the_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    views = make_faulty_views(None, orbit_trajectory(4, 60), np.random.default_rng(5))

    def draw(floor_nats: float, strengths: list[float]) -> NullLevel:
        coming = iter(strengths)
        monkeypatch.setattr("locate.fusion.search.null.draw_strongest", lambda *_: next(coming))
        return NullLevel.from_views(
            views,
            views.volume(),
            np.random.default_rng(0),
            progress=lambda _: None,
            least_nats=floor_nats,
        )

    quiet, loud = [10.0, 12.0, 14.0] * 4, [10.0, 12.0, 70.0] * 4
    assert len(draw(80.0, quiet).strongest) == 4
    assert len(draw(0.0, quiet).strongest) == 12
    assert len(draw(25.0, quiet).strongest) == 12
    assert len(draw(80.0, loud).strongest) == 12


@pytest.mark.parametrize(
    ("strengths", "floor_nats", "weakest_nats"),
    [
        ([250.0, 300.0, 3.0, -1.0], 80.0, 250.0),  # far above the floor: only that is held
        ([250.0, 50.0], 80.0, 80.0),  # the second may turn out to be above the floor
        ([250.0, 90.0], 80.0, 90.0),
        ([3.0, -1.0], 80.0, 80.0),  # no plume in sight: the floor decides
        ([], 80.0, 80.0),
        ([250.0, 3.0], 0.0, 3.0),  # no floor: every column may be one
    ],
)
def test_the_level_is_held_against_the_weakest_column_that_may_be_a_plume(
    strengths: list[float], floor_nats: float, weakest_nats: float
) -> None:
    assert weakest_candidate(np.array(strengths), floor_nats) == weakest_nats


def test_a_plume_far_above_chance_takes_few_draws(
    truth: ColumnTruth, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = make_faulty_views(truth, orbit_trajectory(10, 60), np.random.default_rng(5))
    drawn: list[float] = []

    def draw(*_: object) -> float:
        drawn.append([10.0, 12.0, 14.0][len(drawn) % 3])
        return drawn[-1]

    monkeypatch.setattr("locate.fusion.search.null.draw_strongest", draw)
    assert len(fuse(views, least_nats=15.0).plumes) == 1
    with_the_plume, without = 4, 12  # what is left for chance is near the floor
    assert len(drawn) == with_the_plume + without


def test_chance_is_a_gumbel_distribution() -> None:
    null = NullLevel.from_draws([8.0, 9.0, 10.0, 25.0])
    peer = gumbel_r(null.location, null.scale)
    for strength in (-20.0, 5.0, 60.0, 300.0):
        assert null.false_alarm(strength) == pytest.approx(peer.sf(strength), rel=1e-12)
    for share in (0.5, 0.01, 1e-6):
        assert null.threshold(share) == pytest.approx(peer.isf(share), rel=1e-12)


def test_same_seed_same_answer(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(6, 60), np.random.default_rng(0))
    first, second = (fuse(views, seed=3).plumes for _ in range(2))
    assert [p.source.tolist() for p in first] == [p.source.tolist() for p in second]


@pytest.mark.parametrize("seed", range(3))
def test_clutter_alone_is_no_plume(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    views = make_faulty_views(None, orbit_trajectory(10, 60), rng, EvidenceFaults(false_blobs=1.0))
    assert fuse(views).plumes == ()


def test_true_column_scores_more_than_its_neighbours(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    shifts = np.array([[0, 0], [0.5, 0], [-0.5, 0], [0, 0.8], [0, -0.8]])
    columns = [truth.column.shifted(shift) for shift in shifts]
    nats = score_columns(views, Columns.of(columns)).sum(axis=0)
    assert nats.argmax() == 0
    assert nats[0] > 1.2 * nats[1:].max()


def test_evidence_of_a_plume_is_used_once(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    column = truth.column
    left = mask_out(views, column)
    assert (
        score_columns(left, column.as_columns).sum()
        < 0.1 * score_columns(views, column.as_columns).sum()
    )
    assert (views.llr > 0).any()


def beside_each_other(
    truth: ColumnTruth, shift_m: np.ndarray, arc_deg: float, strength: float = 1.0
) -> tuple[Views, ColumnTruth]:
    """Views of a plume and of one so far from it and so much as strong, and the other's truth."""
    rng = np.random.default_rng(0)
    beside = replace(truth, source=truth.source + shift_m)
    first, other = (
        make_faulty_views(plume, orbit_trajectory(8, arc_deg), rng, NO_FAULTS)
        for plume in (truth, beside)
    )
    both = replace(
        first,
        llr=np.maximum(first.llr, other.llr),
        displacement=first.displacement + strength * other.displacement,
    )
    return both, beside


def between(truth: ColumnTruth, beside: ColumnTruth) -> PlumeColumn:
    """A column over both."""
    radius = truth.radius + float(np.linalg.norm(truth.source - beside.source)) / 2
    return replace(truth, source=(truth.source + beside.source) / 2, radius=radius).column


def test_a_column_over_two_plumes_is_split(truth: ColumnTruth) -> None:
    both, beside = beside_each_other(truth, np.array([1.0, 0, 0]), 60)
    parts = split_column(both, between(truth, beside), np.random.default_rng(0))
    assert len(parts) == 2
    for plume in (truth, beside):
        own = plume.column.as_columns
        apart = [np.linalg.norm((part.lowest_point - plume.source)[:2]) for part, _ in parts]
        assert min(apart) < 1 / 3
        left = parts[int(np.argmin(apart))][1]
        assert score_columns(left, own).sum() > 0.5 * score_columns(both, own).sum()


@pytest.mark.parametrize("radius", [0.15, 0.4])
def test_a_column_over_one_plume_is_not_split(truth: ColumnTruth, radius: float) -> None:
    wide = replace(truth, radius=radius)
    views = make_faulty_views(wide, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    assert not split_column(views, wide.column, np.random.default_rng(0))


def test_plumes_that_no_view_separates_are_not_split(truth: ColumnTruth) -> None:
    both, beside = beside_each_other(truth, np.array([0, 1.0, 0]), 10)
    assert not split_column(both, between(truth, beside), np.random.default_rng(0))


def test_where_the_displacement_turns_much_less_is_no_second_plume(truth: ColumnTruth) -> None:
    both, beside = beside_each_other(truth, np.array([1.0, 0, 0]), 60, strength=0.04)
    assert not split_column(both, between(truth, beside), np.random.default_rng(0))


def test_a_gap_lowers_the_contrast_of_a_column_over_two_plumes(truth: ColumnTruth) -> None:
    beside = replace(truth, source=truth.source + np.array([1.6, 0, 0]))
    first, second = (
        make_faulty_views(plume, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
        for plume in (truth, beside)
    )
    loud = np.maximum(first.llr, second.llr)
    both = replace(first, llr=np.where(loud < 0, -0.1, loud).astype(np.float32))
    columns = Columns.of([truth.column, between(truth, beside)])
    assert np.diff(column_evidence(both, columns)) > 0
    assert np.diff(column_contrast(both, columns)) < 0


def test_three_plumes_are_three() -> None:
    truths = [
        replace(random_column(np.random.default_rng(k)), source=np.array([x, y, 0.0]))
        for k, (x, y) in enumerate([(-1.8, 0.3), (0.1, -0.6), (1.7, 0.6)])
    ]
    seen = [
        make_faulty_views(t, orbit_trajectory(10, 60), np.random.default_rng(1), NO_FAULTS)
        for t in truths
    ]
    views = replace(
        seen[0],
        llr=np.maximum.reduce([each.llr for each in seen]),
        displacement=np.sum([each.displacement for each in seen], axis=0),
    )
    null = NullLevel(strongest=np.zeros(2), location=10.0, scale=1.0)
    plumes = fuse(views, null=null).plumes
    assert len(plumes) == 3
    for each in truths:
        assert min(np.linalg.norm(plume.source - each.source) for plume in plumes) < 0.15


def test_errors_that_neighbouring_views_share_are_seen_and_widen_the_covariance(
    seen: tuple[PlumeColumn, AxisSightings, Views],
) -> None:
    column, sightings, views = seen
    rng = np.random.default_rng(4)
    apart = np.abs(np.subtract.outer(sightings.view, sightings.view))
    same = np.equal.outer(sightings.height, sightings.height)
    root = np.linalg.cholesky(same * 0.8**apart + 1e-9 * np.eye(len(sightings)))
    own, shared = (
        estimate_axis(views.trajectory, column, replace(sightings, offset_px=offsets), views.unit)
        for offsets in (rng.normal(size=len(sightings)), root @ rng.normal(size=len(sightings)))
    )
    assert own is not None
    assert shared is not None
    assert own.sway.shared_part < 0.3 < 0.6 < shared.sway.shared_part
    assert np.trace(shared.covariance) > 1.5 * np.trace(own.covariance)


def test_a_sway_that_all_sightings_share_leaves_an_axis(
    seen: tuple[PlumeColumn, AxisSightings, Views],
) -> None:
    column, sightings, views = seen
    shared = Sway(
        covariance_px2=np.full((len(sightings), len(sightings)), 2500.0),
        sigma_px=np.full(len(sightings), 100.0),
        inflation=1.0, shared_part=0.0, rate=0.1, persistence_s=1.0, hypotheses=(),
    )  # fmt: skip
    axis = estimate_axis(views.trajectory, column, sightings, views.unit, sway=shared)
    assert axis is not None
    assert np.isfinite(axis.covariance).all()


def test_base_reaches_down_to_the_ground(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    column = truth.column
    (lifted,) = column.axis_points(np.array([0.3]))
    column = replace(truth, source=lifted, height=truth.height - 0.3).column
    base = locate_base(views, column)
    assert base.height == pytest.approx(-0.3, abs=0.12)
    assert not base.hidden
    assert base.sigma < 0.3


def test_evidence_that_leaks_below_the_source_is_not_the_plume(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    llr = views.llr.copy()
    strong = float(np.percentile(llr[llr > 0], 80))
    for i in range(len(views)):
        row = round(views.trajectory.project(i, truth.source[None])[0, 1])
        llr[i, row:] = 0.15 * strong
    far = np.full_like(views.inverse_depth, 1 / 40)
    base = locate_base(replace(views, llr=llr, inverse_depth=far), truth.column)
    assert abs(base.height) < 0.3
    assert abs(base.height) < 2 * base.sigma


def screened(views: Views, column: PlumeColumn, *, up_to: float, before: float) -> Views:
    """The views with a screen `before` the axis, as high as its point at height `up_to`."""
    llr, inverse_depth = views.llr.copy(), views.inverse_depth.copy()
    edge = column.axis_points(np.array([up_to]))
    for i in range(len(views)):
        row = round(views.trajectory.project(i, edge)[0, 1])
        depth = views.trajectory.world_to_cam(i, edge)[0, 2] - before
        llr[i, row:] = -0.5
        inverse_depth[i, row:] = np.maximum(inverse_depth[i, row:], 1 / depth)
    return replace(views, llr=llr, inverse_depth=inverse_depth)


def test_a_hidden_source_may_be_anywhere_down_to_the_ground(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    column = truth.column
    base = locate_base(screened(views, column, up_to=0.9, before=0.8), column)
    assert base.hidden
    assert base.evidence_low == pytest.approx(0.9, abs=0.15)
    assert base.height == pytest.approx(0.45, abs=0.2)
    assert abs(base.height) < 2 * base.sigma


def test_a_thin_nozzle_is_a_base_and_hides_nothing(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    column = truth.column
    base = locate_base(screened(views, column, up_to=0.3, before=0.1), column)
    assert not base.hidden
    assert base.height == pytest.approx(0.3, abs=0.1)
    assert base.sigma < 0.1


def test_a_plume_is_no_surer_than_plumes_like_it_were_true() -> None:
    strong, weak = (any_plume(evidence_nats=16 * nats, probability=0.9999) for nats in (20, 5))
    assert (
        0.99
        < cap_probability(strong, DetectorChoice.parse("registered+dybs"), 16).probability
        < 0.9999
    )
    assert 0.4 < cap_probability(weak, DetectorChoice.parse("registered"), 16).probability < 0.7
    unsure = replace(strong, probability=0.6)
    assert cap_probability(unsure, DetectorChoice.parse("registered"), 16).probability == 0.6
    assert cap_probability(weak, DetectorChoice.parse("registered-plain"), 16) is weak


def test_a_hidden_source_is_noted_with_its_interval() -> None:
    plume = Plume(
        id=2, source=np.zeros(3), source_covariance=np.diag([0.01, 0.01, 0.25]),
        axis=np.array([0, 0, 1.0]), axis_sigma_rad=0.1, extent_low=0.4, extent_high=3.0,
        radius_by_height=np.array([[0.4, 0.2], [3.0, 0.3]]), evidence_nats=50.0, probability=1.0,
        views=(0, 1), displacement_px=0.5, source_hidden=True,
    )  # fmt: skip
    note = hidden_note(plume, "m")
    assert "plume 2" in note
    assert "between 1 m below and 0.4 m above" in note


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_answer_does_not_depend_on_the_scale_of_the_evidence(
    truth: ColumnTruth, factor: float
) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(5))
    scaled = replace(views, llr=np.clip(factor * views.llr, -1.5, 4))
    answers = []
    for each in (views, scaled):
        null = NullLevel(strongest=np.zeros(2), location=10.0, scale=1.0)
        (plume,) = fuse(each, null=null).plumes
        answers.append(plume)
    sigmas = [np.sqrt(np.trace(plume.source_covariance)) for plume in answers]
    distance = np.linalg.norm(answers[0].source - answers[1].source)
    assert distance < 2 * max(sigmas)
    assert 0.5 < sigmas[0] / sigmas[1] < 2


def test_axis_of_a_shifted_column_is_pulled_back(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(12, 60), np.random.default_rng(1), NO_FAULTS)
    column = truth.column.shifted(np.array([0.1, 0.0]))
    sightings = sight_axis(views, column)
    axis = estimate_axis(views.trajectory, column, sightings, views.unit)
    assert axis is not None
    point, covariance = axis.point_at(0.0)
    assert abs(point[0] - truth.source[0]) < 0.05
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_an_axis_that_columns_disagree_on_is_the_less_known(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(12, 60), np.random.default_rng(1), NO_FAULTS)
    column = truth.column
    axis = estimate_axis(views.trajectory, column, sight_axis(views, column), views.unit)
    assert axis is not None
    lifted = replace(
        axis, lowest=axis.lowest + 0.5, line=axis.line + 0.5 * np.r_[axis.line[2:], 0, 0]
    )
    at, covariance = axis.point_at(0.3)
    same, same_covariance = average_axes([axis, axis]).point_at(0.3)
    np.testing.assert_allclose(same, at)
    np.testing.assert_allclose(same_covariance, covariance)
    np.testing.assert_allclose(average_axes([axis, lifted]).point_at(0.3)[0], at)
    aside = replace(axis, line=axis.line + np.array([0.2, 0, 0, 0]))
    between, wider = average_axes([axis, aside]).point_at(0.3)
    np.testing.assert_allclose(between, at + np.array([0.1, 0, 0]))
    np.testing.assert_allclose(wider - covariance, np.diag([0.01, 0, 0]), atol=1e-9)


def test_an_outlying_search_is_left_out(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    refined = refine_axis(views, truth.column)
    assert refined is not None
    _, axis = refined
    sigma = np.sqrt(axis.covariance[0, 0])
    aside, astray = (
        replace(axis, line=axis.line + np.array([by * sigma, 0, 0, 0])) for by in (1, 4)
    )
    lifted = astray.counting_from(axis.lowest + 0.5)
    np.testing.assert_allclose(lifted.point_at(0.5)[0], astray.point_at(1.0)[0])
    assert mark_consistent([axis, aside, lifted, axis]).tolist() == [True, True, False, True]
    assert mark_consistent([axis]).all()


def test_the_source_hardly_depends_on_the_seed_of_the_search(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(12, 60), np.random.default_rng(1))
    null = NullLevel(strongest=np.zeros(2), location=10.0, scale=1.0)
    plumes = [fuse(views, seed=seed, null=null).plumes[0] for seed in range(4)]
    scatter = np.std([plume.source for plume in plumes], axis=0)
    stated = np.sqrt(np.diag(plumes[0].source_covariance))
    assert (scatter < 0.5 * stated).all()


def offsets_of(sightings: AxisSightings, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Offsets of an upright plume that leans by `rate`, correlated over a second, plus noise."""
    apart_s = np.abs(np.subtract.outer(sightings.time_s, sightings.time_s))
    h = sightings.height
    covariance = (rate * np.minimum.outer(h, h)) ** 2 * np.exp(-apart_s)
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(h)))
    sway = root @ rng.normal(size=(len(h), 2))
    noise = rng.normal(size=len(h))
    return np.asarray((sightings.by_shift * sway).sum(axis=1) + noise)


@pytest.fixture(scope="module")
def seen() -> tuple[PlumeColumn, AxisSightings, Views]:
    upright = replace(random_column(np.random.default_rng(5)), slope=np.zeros(2))
    views = make_faulty_views(
        upright, orbit_trajectory(16, 60), np.random.default_rng(0), NO_FAULTS
    )
    column = upright.column
    sightings = sight_axis(views, column)
    return column, replace(sightings, sigma_px=np.ones(len(sightings))), views


@pytest.mark.parametrize("rate", [0.005, 0.1])
def test_stated_covariance_is_honest_for_calm_and_for_swaying_plumes(
    seen: tuple[PlumeColumn, AxisSightings, Views], rate: float
) -> None:
    column, sightings, views = seen
    rng = np.random.default_rng(0)
    nees = []
    for _ in range(15):
        drawn = replace(sightings, offset_px=offsets_of(sightings, rate, rng))
        axis = estimate_axis(views.trajectory, column, drawn, views.unit)
        assert axis is not None
        error = axis.line[:2] - column.line[:2]
        nees.append(error @ np.linalg.solve(axis.covariance[:2, :2], error) / 2)
    assert 0.4 < np.mean(nees) < 1.8


def test_a_swaying_plume_has_a_higher_rate_than_a_calm_one(
    seen: tuple[PlumeColumn, AxisSightings, Views],
) -> None:
    _, sightings, views = seen
    prior = (np.zeros(4), np.diag([1e-4, 1e-4, 25, 25]))
    still = np.zeros((len(sightings), len(sightings)))
    calm, swaying = (
        np.mean(
            [
                estimate_sway(
                    replace(sightings, offset_px=offsets_of(sightings, rate, rng)),
                    0.0,
                    views.unit,
                    still,
                    prior,
                ).rate
                for rng in map(np.random.default_rng, range(4))
            ]
        )
        for rate in (0.005, 0.1)
    )
    assert calm < 0.02
    assert 0.06 < swaying < 0.16


def test_an_outlying_sighting_loses_weight(seen: tuple[PlumeColumn, AxisSightings, Views]) -> None:
    _, sightings, views = seen
    offsets = offsets_of(sightings, 0.005, np.random.default_rng(2))
    offsets[5] += 25
    prior = (np.zeros(4), np.diag([1e-4, 1e-4, 25, 25]))
    still = np.zeros((len(sightings), len(sightings)))
    sway = estimate_sway(replace(sightings, offset_px=offsets), 0.0, views.unit, still, prior)
    assert sway.sigma_px[5] > 4 * np.median(sway.sigma_px)


def test_views_of_one_instant_give_an_axis(
    seen: tuple[PlumeColumn, AxisSightings, Views],
) -> None:
    column, sightings, views = seen
    offsets = offsets_of(sightings, 0.005, np.random.default_rng(3))
    moving, frozen = (
        estimate_axis(
            views.trajectory,
            column,
            replace(sightings, offset_px=offsets, time_s=time_s),
            views.unit,
        )
        for time_s in (sightings.time_s, np.zeros(len(sightings)))
    )
    assert moving is not None
    assert frozen is not None
    assert frozen.direction_sigma_rad > moving.direction_sigma_rad
    np.testing.assert_allclose(frozen.line[:2], column.line[:2], atol=0.1)


def test_sightings_have_the_derivatives_by_shifts_and_poses(
    seen: tuple[PlumeColumn, AxisSightings, Views],
) -> None:
    column, sightings, views = seen
    row, step = 7, 1e-4
    i = int(sightings.view[row])
    trajectory = views.trajectory
    point = column.axis_points(sightings.height[[row]])
    normal = np.array([1.0, 0.0])  # an upright axis, nearly: cameras here have no roll
    normal *= np.sign(sightings.by_shift[row] @ trajectory.rotations[i][0, :2])
    before = trajectory.project(i, point)[0]
    for k in range(2):
        after = trajectory.project(i, point + step * np.eye(3)[k])[0]
        slope = normal @ (after - before) / step
        assert sightings.by_shift[row, k] == pytest.approx(slope, abs=3)
    for k in range(6):
        turn, shift = (step * np.eye(6)[k]).reshape(2, 3)
        in_cam = trajectory.world_to_cam(i, point) - shift
        in_cam = in_cam @ cv2.Rodrigues(turn)[0]
        slope = normal @ (trajectory.camera.project(in_cam)[0] - before) / step
        assert sightings.by_pose[row, k] == pytest.approx(slope, abs=15)


def test_a_section_without_evidence_gives_no_sighting(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(0), NO_FAULTS)
    column = truth.column
    silent = views.llr.copy()
    silent[silent > 0] = 0.1
    assert len(sight_axis(views, column)) > 20
    assert len(sight_axis(replace(views, llr=silent), column)) == 0


def test_wider_arc_is_surer(truth: ColumnTruth) -> None:
    sigmas = []
    for arc in (20, 60):
        views = make_faulty_views(truth, orbit_trajectory(10, arc), np.random.default_rng(2))
        (plume,) = fuse(views).plumes
        sigmas.append(plume.principal_sigmas[0])
    assert sigmas[0] > 1.5 * sigmas[1]


def test_best_interval_is_the_largest_run_sum() -> None:
    evidence = np.array([-1, 2, 3, -1, 2, -9, 4], np.float32)[:, None, None]
    total, first, last = best_interval(evidence)
    assert (total.item(), first.item(), last.item()) == (6, 1, 4)


def test_frames_without_evidence_are_counted() -> None:
    mute = Detection.without_evidence((4, 6), depth=True)
    seen = replace(mute, llr=np.ones((4, 6), np.float32))
    (note,) = empty_frames_notes([mute, seen, mute], DetectorChoice.parse("registered+dybs"))
    assert note.startswith("2 of 3 frames")
    (advice,) = empty_frames_notes([mute], DetectorChoice.parse("registered"), with_count=False)
    assert note.endswith(advice)
    assert advice.startswith("--detector registered-plain")
    assert empty_frames_notes([seen], DetectorChoice.parse("registered")) == []
    assert empty_frames_notes([mute], DetectorChoice.parse("registered-plain")) == []


def test_the_axis_is_sought_in_the_core_of_a_plume(truth: ColumnTruth) -> None:
    views = make_faulty_views(truth, orbit_trajectory(12, 60), np.random.default_rng(1), NO_FAULTS)
    column = truth.column
    width = views.llr.shape[2]
    beside = np.maximum(views.llr, np.roll(views.llr, width // 80, axis=2))
    upwards = np.zeros_like(views.displacement)
    upwards[..., 1] = np.where(views.llr > 0, 1, 0.15)
    halo = replace(views, llr=beside)
    offsets = [
        sight_axis(replace(halo, displacement=bent), column).offset_px
        for bent in (upwards, np.sign(upwards))
    ]
    assert abs(np.median(offsets[0])) < 0.5 * abs(np.median(offsets[1]))


def test_stated_covariance_is_honest_for_bent_plumes(
    seen: tuple[PlumeColumn, AxisSightings, Views],
) -> None:
    column, sightings, views = seen
    rng = np.random.default_rng(0)
    nees = []
    for _ in range(15):
        path = 0.5 * rng.normal(size=2) * (sightings.height[:, None] / column.height) ** 2
        offsets_px = (sightings.by_shift * path).sum(axis=1) + rng.normal(size=len(sightings))
        drawn = replace(sightings, offset_px=offsets_px)
        axis = estimate_axis(views.trajectory, column, drawn, views.unit)
        assert axis is not None
        error = axis.line[:2] - column.line[:2]
        nees.append(error @ np.linalg.solve(axis.covariance[:2, :2], error) / 2)
    assert np.mean(nees) < 1.8
