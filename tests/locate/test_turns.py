from dataclasses import replace

import numpy as np
import pytest

from detect.information import DisplacementInformation
from geometry.grid import sum_evidence
from locate.fusion.axis.estimate import AxisEstimate
from locate.fusion.find import FoundPlumes
from locate.fusion.fuse import FusionResult
from locate.fusion.limit import detection_limit_px
from locate.fusion.matched import plumes
from locate.fusion.matched.evidence import with_turn_evidence
from locate.fusion.matched.filters import turn_kernel
from locate.fusion.matched.fit import Turn, agreed_sigmas, find_turns
from locate.fusion.matched.plumes import (
    RADIUS_WIDTHS,
    TurnSearch,
    column_of,
    is_near,
    join_turn,
    strength_of_turn,
)
from locate.fusion.matched.probability import passes, true_probability
from locate.fusion.matched.scan import propose_turns
from locate.fusion.matched.score import SHARED, TurnScore, join_sides
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.source.base import locate_base
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.simulation.evidence import (
    NO_FAULTS,
    ColumnTruth,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)

NOISE_PX = 0.5
BESIDE_PX = 14


@pytest.fixture(scope="module")
def truth() -> ColumnTruth:
    return random_column(np.random.default_rng(5))


def views_of(
    truth: ColumnTruth | None, share: float, *, sides: str = "both", beside: float = 0.0
) -> Views:
    """Views whose pixels measure a share of the displacement in noise, and give no evidence.

    Args:
        truth: The plume; None: no plume.
        share: Of its displacement.
        sides: "one": only what points to the right.
        beside: This much of it is taken away to either side, where neighbours see it.
    """
    rng = np.random.default_rng(9)
    views = make_faulty_views(truth, orbit_trajectory(12, 60), rng, NO_FAULTS)
    information = []
    for displacement in views.displacement:
        seen = displacement.copy()
        if sides == "one":
            seen = np.maximum(seen, 0)
        for shift in (-BESIDE_PX, BESIDE_PX):
            seen -= beside * np.roll(displacement, shift, axis=1)
        measured = share * seen + rng.normal(0, NOISE_PX, displacement.shape)
        precision = np.full(displacement.shape[:2], NOISE_PX**-2)
        matrix = np.stack([precision, 0 * precision, precision], axis=-1)
        information.append(
            DisplacementInformation(
                vector=(precision[..., None] * measured).astype(np.float32),
                matrix=matrix.astype(np.float32),
            )
        )
    views = replace(views, information=tuple(information))
    return views.with_evidence(np.zeros_like(views.llr))


def search_of(views: Views) -> TurnSearch:
    grid = sum_evidence(views.volume(), views.trajectory, views.llr, views.inverse_depth)
    search = TurnSearch.of_views(views, grid, np.random.default_rng(0))
    assert search is not None
    return search


@pytest.fixture(scope="module")
def search(truth: ColumnTruth) -> TurnSearch:
    """Of views with a plume well below the noise of a pixel."""
    return search_of(views_of(truth, 0.4))


@pytest.fixture(scope="module")
def plume(search: TurnSearch) -> Plume:
    """The only one there."""
    (plume,) = search.find_plumes([], np.random.default_rng(1)).plumes
    return plume


def narrow_column(truth: ColumnTruth) -> Columns:
    """The true column, its radius that of the largest displacement."""
    slopes, width = truth.slope, truth.radius / RADIUS_WIDTHS
    return PlumeColumn(np.array([*truth.source, *slopes, truth.height, width, 0.0])).as_columns


def with_more_views(views: Views, count: int) -> Views:
    """The same, as though the last `count` told their displacement alone."""
    sigma_px = views.sigma_px.copy()
    sigma_px[-count:] = np.inf
    return replace(views, sigma_px=sigma_px, displacement_only=count)


def turns_of(views: Views) -> list[Turn]:
    search = search_of(views)
    proposals = propose_turns(search.score.filters, search.grid)
    return find_turns(search.score, proposals, np.random.default_rng(0))


def test_a_plume_far_below_the_noise_of_a_pixel_is_found(truth: ColumnTruth) -> None:
    views = views_of(truth, 0.2)
    assert 0.2 * np.abs(views.displacement).max() < 0.6 * NOISE_PX
    best = turns_of(views)[0]
    assert best.sigmas > 10
    height = np.array([truth.height / 2 + truth.source[2] - best.column.lowest_z])
    middle = best.column.axis_points(height)[0]
    axis = truth.source + truth.height / 2 * np.array([*truth.slope, 1.0])
    assert np.linalg.norm(middle[:2] - axis[:2]) < 0.3


def test_a_denser_gas_turns_the_other_way(truth: ColumnTruth) -> None:
    assert turns_of(views_of(truth, -0.2))[0].sigmas < -10


@pytest.mark.parametrize("share", [-5.0, 2.0, 5.0])
def test_what_neighbours_see_beside_a_strong_plume_is_no_turn(
    truth: ColumnTruth, share: float
) -> None:
    turns = turns_of(views_of(truth, share, beside=0.3))
    assert turns[0].sigmas * np.sign(share) > 10
    assert all(abs(turn.sigmas) < 10 for turn in turns[1:])


def test_noise_turns_nowhere() -> None:
    assert max(abs(turn.sigmas) for turn in turns_of(views_of(None, 0.0))) < 7


def test_what_is_displaced_on_one_side_alone_is_no_turn(truth: ColumnTruth) -> None:
    both, one = (turns_of(views_of(truth, 0.2, sides=sides))[0] for sides in ("both", "one"))
    assert abs(one.sigmas) < 0.7 * abs(both.sigmas)


def test_the_weaker_side_decides() -> None:
    sides = np.array([[3.0, 3.0, 3.0, -3.0], [3.0, 1.0, -3.0, -1.0]])
    root = np.sqrt(2)
    np.testing.assert_allclose(join_sides(*sides), [3 * root, root, 0, -root])


def test_a_turn_is_antisymmetric_across_its_axis() -> None:
    kernel, off, direction = turn_kernel(3.0, np.pi / 6)
    np.testing.assert_allclose(kernel, -kernel[::-1, ::-1], atol=1e-6)
    np.testing.assert_allclose(direction, [np.sqrt(3) / 2, 0.5])
    assert (kernel[off > 0] >= 0).all()


def test_a_plume_needs_a_turn_whatever_its_pixels_say() -> None:
    sigmas, nats = np.array([10.0, 7.5, 7.5, 3.0]), np.array([0.0, 0.0, 20.0, 300.0])
    assert passes(sigmas, nats).tolist() == [True, False, True, False]


def test_gases_that_bend_light_inwards_are_rarer() -> None:
    out, inward = true_probability([8.0, -8.0], 5.0)
    assert inward < out
    assert true_probability(8.0, -3.0) == true_probability(8.0, 0.0)


def test_what_a_few_views_show_is_not_what_the_views_agree_on(
    truth: ColumnTruth, search: TurnSearch
) -> None:
    every, none = search.score.filters.views, views_of(None, 0.0)
    few = replace(every, information=(*every.information[:4], *none.information[4:]))
    column = find_turns(search.score, narrow_column(truth), np.random.default_rng(0))[0].column
    for each, agree in ((search.score, True), (search_of(few).score, False)):
        agreed = each.agreed(column.as_columns)[0]
        assert (agreed > 0.8 * each(column.as_columns)[0]) == agree


def test_what_views_agree_on_hardly_depends_on_random_draws(truth: ColumnTruth) -> None:
    score = search_of(views_of(truth, 0.3)).score
    met, climbed = list[float](), list[float]()
    for seed in range(4):
        turn = find_turns(score, narrow_column(truth), np.random.default_rng(seed))[0]
        met.append(float(score.agreed(turn.column.as_columns)[0]))
        climbed.append(agreed_sigmas(score, turn, np.random.default_rng(seed)))
    assert min(climbed) > max(met)
    assert np.ptp(climbed) < 0.5 * np.ptp(met)


def test_the_evidence_of_pixels_needs_a_turn(search: TurnSearch, plume: Plume) -> None:
    elsewhere = replace(plume, source=plume.source + np.array([2.0, 0, 0]), evidence_nats=1e4)
    kept = search.confirm([elsewhere, plume], np.random.default_rng(1)).plumes
    assert [each.source.tolist() for each in kept] == [plume.source.tolist()]


def test_a_plume_without_evidence_of_pixels_is_measured(truth: ColumnTruth, plume: Plume) -> None:
    error = plume.source - truth.source
    assert np.linalg.norm(error[:2]) < 0.05 * 8.5
    assert plume.refractive_index == "lower"
    assert 0.5 < plume.probability < 1


def test_a_known_plume_is_not_found_again(search: TurnSearch, plume: Plume) -> None:
    assert search.find_plumes([plume], np.random.default_rng(1)).plumes == []


def test_what_a_plume_explains_supports_no_other(search: TurnSearch, plume: Plume) -> None:
    own = column_of(plume)
    (middle,) = own.cut_slabs(np.array([own.height / 2]), own.height / 2)
    turn = middle.widened(1 / RADIUS_WIDTHS)
    beside = turn.shifted(np.array([0.1, 0.0])).as_columns
    rest = search.score.without(own)
    assert abs(search.score(turn.as_columns)[0]) > 10
    assert abs(rest(turn.as_columns)[0]) < 3
    assert abs(rest(beside)[0]) < abs(search.score(beside)[0])


def test_a_found_plume_is_masked_out_where_it_was_measured(
    monkeypatch: pytest.MonkeyPatch, search: TurnSearch
) -> None:
    masked, without = list[PlumeColumn](), TurnScore.without

    def recorded(score: TurnScore, *columns: PlumeColumn) -> TurnScore:
        masked.extend(columns)
        return without(score, *columns)

    monkeypatch.setattr(TurnScore, "without", recorded)
    found = search.find_plumes([], np.random.default_rng(1)).plumes
    assert found
    own = column_of(found[0])
    assert any(
        own.widest_gap_to(column) < 1e-9 and own.radius == column.radius for column in masked
    )


def test_where_a_turn_would_show_little_its_absence_counts_little(truth: ColumnTruth) -> None:
    views = views_of(truth, 0.4)
    covered_up_to = truth.column.axis_points(np.array([0.6 * truth.height]))
    dimmed = []
    for i, full in enumerate(views.information):
        weight = np.ones(views.llr.shape[1:], np.float32)
        weight[int(views.trajectory.project(i, covered_up_to)[0, 1]) :] = 0.01
        dimmed.append(
            DisplacementInformation(
                vector=full.vector * weight[..., None], matrix=full.matrix * weight[..., None]
            )
        )
    column = PlumeColumn(narrow_column(truth).array[0])
    filled = with_turn_evidence(replace(views, information=tuple(dimmed)), Turn(column, 25.0))
    wide = column.widened(RADIUS_WIDTHS)
    base, without = locate_base(filled, wide), locate_base(replace(filled, foreseen=None), wide)
    assert without.height > 2 * without.sigma
    assert abs(base.height) < base.sigma


def test_plumes_whose_axes_meet_are_one(plume: Plume) -> None:
    aside, unit = np.array([3.0, 0.0, 0.0]), 0.85
    meeting = plume.points_on_axis(np.array([plume.extent_high / 2]))[0] - (plume.source - aside)
    slanted = replace(
        plume, source=plume.source - aside, axis=meeting / np.linalg.norm(meeting), extent_high=6.0
    )
    assert is_near(slanted, [plume], unit)
    assert not is_near(replace(plume, source=plume.source - aside), [plume], unit)


def test_axes_that_show_as_much_spread_that_of_a_turn(truth: ColumnTruth) -> None:
    straight = narrow_column(truth)[0]
    slanted = [
        straight.on_line(straight.line + np.array([0, 0, slope, 0])) for slope in (-0.2, 0.2)
    ]
    raised = slanted[1].moved_to(slanted[1].axis_points(np.array([0.5]))[0])
    far = straight.shifted(np.array([1.0, 0.0]))
    columns = Columns.of([straight, slanted[0], raised, far])
    alike = Turn.best_of(columns, np.array([9.0, 9.0, 9.0, 9.0]), 0, 0.3)
    worse = Turn.best_of(columns, np.array([9.0, 6.0, 6.0, 9.0]), 0, 0.3)
    opposite = Turn.best_of(columns, np.array([9.0, -9.0, -9.0, -9.0]), 0, 0.3)
    expected = np.zeros((4, 4))
    expected[2, 2] = 2 * 0.2**2 / 3
    assert alike.spread == pytest.approx(expected)
    assert np.abs(worse.spread).max() < 1e-6
    assert not opposite.spread.any()


def test_a_plume_seen_at_one_height_has_a_column(search: TurnSearch, plume: Plume) -> None:
    column = column_of(replace(plume, extent_high=plume.extent_low))
    assert np.isfinite(column.as_columns.axis_points(np.zeros((1, 1)))).all()
    assert column.height == 0
    assert column.opening == 0
    assert np.isfinite(search.score.without(column)(column_of(plume).as_columns)).all()


def test_views_without_information_are_not_searched(truth: ColumnTruth) -> None:
    views = replace(views_of(truth, 0.2), information=())
    grid = sum_evidence(views.volume(), views.trajectory, views.llr, views.inverse_depth)
    assert TurnSearch.of_views(views, grid, np.random.default_rng(0)) is None


def test_the_limit_is_lower_where_turns_are_searched_for(truth: ColumnTruth) -> None:
    views = views_of(None, 0.0)
    views = views.with_evidence(np.full_like(views.llr, -0.01))
    alone = detection_limit_px(views, 1e6)
    with_turns = detection_limit_px(views, 1e6, turns=search_of(views))
    assert alone is None
    assert with_turns is not None
    assert with_turns < 3 * NOISE_PX


def test_views_of_the_displacement_alone_add_to_the_turn(truth: ColumnTruth) -> None:
    views = with_more_views(views_of(truth, 0.2), 6)
    assert (len(views), len(views.by_pixels)) == (12, 6)
    assert views.by_pixels.unit == views.unit
    assert views.by_pixels.by_pixels is views.by_pixels
    few, all_views = turns_of(views.by_pixels)[0], turns_of(views)[0]
    assert abs(all_views.sigmas) > 1.2 * abs(few.sigmas)


def test_evidence_of_pixels_is_counted_by_the_views_that_have_some(truth: ColumnTruth) -> None:
    views = views_of(truth, 0.4)
    evident = views.with_evidence(np.full_like(views.llr, 0.01))
    strengths = []
    for each in (evident, with_more_views(evident, 4)):
        llr = each.llr.copy()
        llr[len(each.by_pixels) :] = 0
        score = search_of(each.with_evidence(llr)).score
        turn = Turn(PlumeColumn(narrow_column(truth).array[0]), 1.0)
        strengths.append(strength_of_turn(score, turn, np.random.default_rng(1)))
    assert strengths[1].nats_per_view == pytest.approx(strengths[0].nats_per_view, rel=0.2)


@pytest.mark.parametrize(
    ("probabilities", "rejected", "limit_px", "unsure"),
    [
        ([0.999], 0.5, 0.1, False),
        ([0.9, 0.999], 0.0, 0.1, True),
        ([], 0.5, 0.1, True),
        ([], 0.1, 0.1, False),
        ([], 0.1, None, True),
        ([0.999], 0.0, None, False),
    ],
)
def test_what_more_frames_may_change_is_unsure(
    search: TurnSearch,
    plume: Plume,
    probabilities: list[float],
    rejected: float,
    limit_px: float | None,
    unsure: bool,
) -> None:
    found = FoundPlumes(
        plumes=tuple(replace(plume, probability=each) for each in probabilities),
        by_pixels=FusionResult(plumes=(), grid=None, threshold_nats=1.0),
        unconfirmed=0,
        turns=search,
        limit_px=limit_px,
        rejected=rejected,
    )
    assert found.is_unsure is unsure
    assert not replace(found, turns=None).is_unsure


def test_a_turn_without_an_axis_leaves_doubt(
    search: TurnSearch, plume: Plume, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plumes, "find_axis", lambda *_: None)
    none = search.find_plumes([], np.random.default_rng(1))
    assert none.plumes == []
    assert none.rejected == pytest.approx(plume.probability)


@pytest.mark.parametrize(("on_turn", "x"), [(True, 0.2), (False, 0.0)])
def test_what_pixels_and_turn_differ_by_widens_the_covariance(on_turn: bool, x: float) -> None:
    axis = AxisEstimate(lowest=1.0, line=np.zeros(4), covariance=0.01 * np.eye(4), sway=None)
    turn = Turn(PlumeColumn(np.array([0.2, 0, 1, 0, 0, 2, 0.1, 0])), sigmas=9.0)
    column, joined = join_turn(turn.column.shifted(np.array([-0.2, 0])), axis, turn, on_turn)
    np.testing.assert_allclose(joined.line, [x, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(column.line, joined.line, atol=1e-9)
    np.testing.assert_allclose(joined.covariance - axis.covariance, np.diag([0.02, 0, 0, 0]))


def test_the_spread_of_a_turn_grows_away_from_it() -> None:
    axis = AxisEstimate(lowest=1.0, line=np.zeros(4), covariance=0.01 * np.eye(4), sway=None)
    spread = np.diag([0.01, 0, 0.04, 0])
    turn = Turn(PlumeColumn(np.array([0, 0, 3, 0, 0, 2, 0.1, 0])), sigmas=9.0, spread=spread)
    _, own = join_turn(turn.column, axis, turn, True)
    _, other = join_turn(turn.column, axis, turn, False)
    assert own.covariance[0, 0] - axis.covariance[0, 0] == pytest.approx(0.01 + 2**2 * 0.04)
    np.testing.assert_allclose(other.covariance, axis.covariance)


def test_views_that_err_alike_count_once(truth: ColumnTruth) -> None:
    once = views_of(truth, 0.2)
    rows = np.repeat(np.arange(len(once)), 3)
    thrice = replace(
        once,
        trajectory=once.trajectory.take(rows),
        llr=once.llr[rows],
        inverse_depth=once.inverse_depth[rows],
        displacement=once.displacement[rows],
        sigma_px=once.sigma_px[rows],
        information=tuple(once.information[row] for row in rows),
    )
    columns = narrow_column(truth)
    one, three = (float(search_of(views).score.agreed(columns)[0]) for views in (once, thrice))
    shared = np.sqrt((1 + SHARED * len(once)) / (1 + SHARED * len(thrice)))
    assert three == pytest.approx(shared * one, rel=0.2)
