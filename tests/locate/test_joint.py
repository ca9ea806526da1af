from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from locate.fusion import joint
from locate.fusion.fuse import fuse
from locate.fusion.joint import JointColumns, measure_together
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import fit_columns
from locate.fusion.search.null import NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_contrast, explained_pixels, mask_out
from locate.fusion.views import Views, correlation_area, correlation_area_of
from locate.map.plume import Plume
from locate.simulation.evidence import (
    ColumnTruth,
    add_plume,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)

VIEWS, ARC_DEG = 16, 60
FLOOR_NATS = 5.0 * VIEWS
PLACES_M = ((0.2, -1.5), (-0.7, 0.3), (0.9, 1.2))


@pytest.fixture(scope="module")
def truths() -> list[ColumnTruth]:
    return [
        replace(random_column(np.random.default_rng(k)), source=np.array([*place, 0.0]))
        for k, place in enumerate(PLACES_M)
    ]


@pytest.fixture(scope="module")
def views(truths: list[ColumnTruth]) -> Views:
    rng, trajectory = np.random.default_rng(1), orbit_trajectory(VIEWS, ARC_DEG)
    views = make_faulty_views(truths[0], trajectory, rng)
    for truth in truths[1:]:
        views = add_plume(views, truth, trajectory, rng)
    return views


@pytest.fixture(scope="module")
def starts(views: Views) -> Columns:
    proposals, _ = propose_columns(views, views.volume(), most=MOST_PROPOSALS)
    return fit_columns(
        partial(column_contrast, views), proposals.columns, views.unit, np.random.default_rng(1)
    )


@pytest.fixture(scope="module")
def together(views: Views, starts: Columns) -> JointColumns:
    rng = np.random.default_rng(1)
    return JointColumns.search(views, starts, views.volume(), rng, least_nats=FLOOR_NATS)


def test_plumes_that_hide_each_other_are_found(truths: list[ColumnTruth], views: Views) -> None:
    plumes = fuse(views, seed=0, least_nats=FLOOR_NATS).plumes
    assert [plume.id for plume in plumes] == [1, 2, 3]
    for truth in truths:
        assert min(np.linalg.norm(plume.source - truth.source) for plume in plumes) < 0.3


def test_each_is_counted_where_it_is_the_only_one(views: Views, together: JointColumns) -> None:
    candidates = together.candidates(FLOOR_NATS)
    explained = [explained_pixels(views, column) for column, _ in candidates]
    for k, (_, alone) in enumerate(candidates):
        others = np.any(explained[:k] + explained[k + 1 :], axis=0)
        assert not alone.llr[others].any()
        assert (alone.llr == views.llr)[explained[k] & ~others].all()
        assert (explained[k] & ~others).any()
        assert alone.correlation_px2 < 0.8 * views.correlation_px2
        assert alone.unit == views.unit


def test_weaker_ones_are_no_candidates(together: JointColumns) -> None:
    strong, all_of_them = (len(together.candidates(nats)) for nats in (1e6, 0.0))
    assert strong == 0
    assert all_of_them == len(together) >= 3


def test_a_plume_needs_what_chance_makes_in_its_own_samples(together: JointColumns) -> None:
    candidates = together.candidates(FLOOR_NATS)
    levels: list[float] = []

    def level_nats(null: NullLevel) -> float:
        levels.append(float(null.strongest.max()))
        return np.inf

    null = NullLevel.from_draws([10.0, 20.0])
    assert measure_together(candidates, null, 50.0, level_nats, np.random.default_rng(0)) == []
    expected = [20.0 * 50.0 / alone.correlation_px2 for _, alone in candidates]
    assert levels == pytest.approx(expected)


@pytest.mark.parametrize("plumes", [0, 1])
def test_one_plume_is_not_searched_for_again(
    truths: list[ColumnTruth], plumes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        pytest.fail("a joint search has begun")

    monkeypatch.setattr(JointColumns, "_add", refuse)
    truth = truths[0] if plumes else None
    rng = np.random.default_rng(2)
    views = make_faulty_views(truth, orbit_trajectory(VIEWS, ARC_DEG), rng)
    assert len(fuse(views, least_nats=FLOOR_NATS).plumes) == plumes


def test_where_none_is_found_one_by_one_none_is_searched_for_together(
    views: Views, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        pytest.fail("a joint search has begun")

    def forget(*_: object, level_nats: float, **__: object) -> tuple[list[Plume], float]:
        return [], level_nats

    monkeypatch.setattr("locate.fusion.fuse._add_far_plumes", forget)
    monkeypatch.setattr(JointColumns, "search", refuse)
    assert fuse(views, least_nats=FLOOR_NATS).plumes == ()


def test_a_column_without_an_axis_is_not_tried_again(
    views: Views, starts: Columns, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[PlumeColumn] = []
    monkeypatch.setattr(joint, "refine_axis", lambda _views, column: tried.append(column))
    rng = np.random.default_rng(1)
    found = JointColumns.search(views, starts, views.volume(), rng, least_nats=FLOOR_NATS)
    assert len(found) == 0
    assert len(tried) > len(starts) / 2


def test_what_a_column_explains_is_what_masking_takes(
    truths: list[ColumnTruth], views: Views
) -> None:
    column = truths[0].column
    masked = mask_out(views, column).llr
    explained = explained_pixels(views, column)
    assert explained.any()
    assert (masked == np.where(explained, 0, views.llr)).all()


def test_correlation_is_that_of_the_pixels_that_count() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(4, 120, 160)).astype(np.float32)
    wide = noise.copy()
    wide[:, 30:90, 60:100] = 3.0
    counted = wide == noise
    everything = np.ones_like(counted)
    assert correlation_area_of(noise, everything) == pytest.approx(correlation_area(noise), rel=0.1)
    assert correlation_area(wide) > 20
    assert correlation_area_of(wide, counted) < 2 * correlation_area(noise)
    assert correlation_area_of(wide, ~everything) == 1


def test_chance_in_other_samples_is_as_much_stronger() -> None:
    null = NullLevel.from_draws([20.0, 60.0, 90.0])
    scaled = null.scaled(3.0)
    assert scaled.threshold(0.01) == pytest.approx(3 * null.threshold(0.01))
    assert scaled.false_alarm(300.0) == pytest.approx(null.false_alarm(100.0))
