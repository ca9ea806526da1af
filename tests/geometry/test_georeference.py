"""The fit: what it finds, what it says of its own uncertainty, what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.errors import BadInputError
from geometry.georeference import (
    Alignment,
    Georeference,
    HeightDatum,
    PositionConstraint,
    ScaleConstraint,
    UpConstraint,
    fit_similarity,
)
from geometry.georeference.constraints import apply_tangent, point_jacobian
from geometry.similarity import Similarity
from tests.geometry.surveys import arc, strips, survey, tangent_between

DRAWS = 200
SOURCE_IN_ENU = np.array([[40.0, 20.0, 1.0]])
AXIS = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
GEOMETRIC_SIGMA_M = 0.3


def test_the_tangent_is_the_documented_one() -> None:
    similarity = Similarity(scale=2.0, rotation=np.eye(3), translation=np.array([1.0, 2.0, 3.0]))
    step, points = 1e-6 * np.arange(1.0, 8.0), np.array([[3.0, -1.0, 2.0], [0.0, 5.0, 1.0]])
    change = apply_tangent(similarity, step)(points) - similarity(points)
    np.testing.assert_allclose(change, point_jacobian(similarity(points)) @ step, atol=1e-9)


@pytest.mark.parametrize("known_up", [False, True])
def test_exact_fixes_give_the_exact_similarity(known_up: bool) -> None:
    rng = np.random.default_rng(4)
    flight = survey(strips(20), rng, sigmas_m=np.zeros(3))
    constraints = [flight.fixes, *([flight.gravity(rng, 1e-9)] if known_up else [])]
    fitted = fit_similarity(constraints)
    error = tangent_between(fitted.target_from_source, flight.enu_from_scene)
    np.testing.assert_allclose(error, 0, atol=1e-6)
    assert fitted.metric
    assert fitted.gravity
    assert fitted.located


def test_outliers_do_not_move_the_scale() -> None:
    """A third of the fixes is up to 50 m off; least squares would be off by several per cent."""
    worst = 0.0
    for seed in range(10):
        flight = survey(strips(40), np.random.default_rng([7, seed]), outliers=0.33)
        fitted = fit_similarity([flight.fixes])
        worst = max(worst, abs(fitted.target_from_source.scale * flight.scene_from_enu.scale - 1))
        assert fitted.sources[0].outliers >= 5
    assert worst < 0.02


def test_half_a_metre_of_noise_and_gravity_is_half_a_per_cent() -> None:
    errors = []
    for seed in range(11):
        rng = np.random.default_rng([11, seed])
        flight = survey(arc(60), rng, outliers=0.1, sigmas_m=np.full(3, 0.5))
        fitted = fit_similarity([flight.fixes, flight.gravity(rng, np.radians(0.3))])
        error = tangent_between(fitted.target_from_source, flight.enu_from_scene)
        errors.append([abs(error[6]), np.degrees(np.linalg.norm(error[:2]))])
    scale, tilt_deg = np.median(errors, axis=0)
    assert scale < 0.005
    assert tilt_deg < 0.5


@pytest.mark.parametrize(
    ("path", "correlation_s", "known_up"),
    [(strips(24), 0.0, False), (arc(24), 0.0, True), (strips(48), 3.0, False)],
    ids=["strips", "arc with gravity", "correlated"],
)
def test_a_plumes_covariance_honours_the_error_of_its_frame(
    path: np.ndarray, correlation_s: float, known_up: bool
) -> None:
    """NEES per degree of freedom of source and axis: fixes of 0.5 m, one in ten up to 50 m off."""
    sources, axes = [], []
    for seed in range(DRAWS):
        rng = np.random.default_rng([2024, seed])
        flight = survey(path, rng, outliers=0.1, correlation_s=correlation_s)
        ups = [flight.gravity(rng, np.radians(0.5))] if known_up else []
        fitted = fit_similarity([flight.fixes, *ups])
        seen_in_enu = SOURCE_IN_ENU + rng.normal(size=(1, 3)) * GEOMETRIC_SIGMA_M
        source = fitted.target_from_source(flight.scene_from_enu(seen_in_enu))
        covariance = GEOMETRIC_SIGMA_M**2 * np.eye(3) + fitted.position_covariances(source)[0]
        error = (source - SOURCE_IN_ENU)[0]
        sources.append(error @ np.linalg.solve(covariance, error) / 3)
        axis = fitted.target_from_source.rotation @ flight.scene_from_enu.rotation @ AXIS
        squared = ((axis - AXIS) ** 2).sum()
        axes.append(squared / (2 * fitted.direction_sigma_rad(axis) ** 2))
    assert 0.7 < np.mean(sources) < 1.5
    assert 0.7 < np.mean(axes) < 1.5


def test_a_shared_error_is_added_to_the_place_alone() -> None:
    flight = survey(strips(30), np.random.default_rng(3))
    fixes = vars(flight.fixes) | {"shared_sigma_m": (2.0, 2.0, 4.0)}
    alone, shared = fit_similarity([flight.fixes]), fit_similarity([PositionConstraint(**fixes)])
    added = shared.position_covariances(SOURCE_IN_ENU) - alone.position_covariances(SOURCE_IN_ENU)
    np.testing.assert_allclose(added[0], np.diag([4.0, 4.0, 16.0]), atol=1e-9)
    assert shared.scale_sigma == pytest.approx(alone.scale_sigma)


def test_correlated_fixes_are_worth_less() -> None:
    counts = {
        tau: np.mean(
            [
                fit_similarity(
                    [survey(strips(60), np.random.default_rng([5, i]), correlation_s=tau).fixes]
                )
                .sources[0]
                .effective_count
                for i in range(5)
            ]
        )
        for tau in (0.0, 5.0)
    }
    assert counts[0.0] > 20
    assert counts[5.0] < 0.3 * counts[0.0]


def test_a_straight_path_needs_gravity() -> None:
    rng = np.random.default_rng(8)
    line = np.stack([np.linspace(0, 100, 30), np.zeros(30), np.full(30, 20.0)], axis=1)
    flight = survey(line, rng)
    with pytest.raises(BadInputError, match="give gravity"):
        fit_similarity([flight.fixes])
    fitted = fit_similarity([flight.fixes, flight.gravity(rng, np.radians(0.5))])
    assert np.degrees(fitted.tilt_sigma_rad) < 1.0


def test_without_positions_the_frame_keeps_its_heading_and_origin() -> None:
    tilted = Rotation.from_euler("x", 20, degrees=True).as_matrix()
    up = UpConstraint(name="gimbal", up_in_source=tilted.T @ [0.0, 0.0, 1.0], sigma_rad=0.01)
    fitted = fit_similarity(
        [up, ScaleConstraint(name="board", metres_per_unit=3.0, sigma_log=0.01)]
    )
    np.testing.assert_allclose(fitted.target_from_source.rotation, tilted, atol=1e-9)
    assert fitted.target_from_source.scale == pytest.approx(3.0)
    np.testing.assert_allclose(np.diag(fitted.covariance), [1e-4, 1e-4, 0, 0, 0, 0, 1e-4])
    assert fitted.metric
    assert fitted.gravity
    assert not fitted.located
    alone = fit_similarity([up])
    assert not alone.metric
    assert alone.target_from_source.scale == 1.0


def test_an_alignment_survives_its_block() -> None:
    fitted = fit_similarity([survey(strips(20), np.random.default_rng(2)).fixes])
    block = json.loads(json.dumps(fitted.to_dict()))
    read = Alignment.from_dict(block)
    np.testing.assert_allclose(
        read.target_from_source(SOURCE_IN_ENU), fitted.target_from_source(SOURCE_IN_ENU)
    )
    np.testing.assert_array_equal(read.covariance, fitted.covariance)
    assert read.sources == fitted.sources
    assert read.located
    with pytest.raises(BadInputError, match="covariance"):
        Alignment.from_dict({name: block[name] for name in block if name != "covariance"})


def test_two_scales_are_weighed_by_their_uncertainty() -> None:
    fitted = fit_similarity(
        [
            ScaleConstraint(name="board", metres_per_unit=2.0, sigma_log=0.01),
            ScaleConstraint(name="distance", metres_per_unit=2.04, sigma_log=0.02),
        ]
    )
    expected = np.exp((np.log(2.0) / 0.01**2 + np.log(2.04) / 0.02**2) / (1 / 1e-4 + 1 / 4e-4))
    assert fitted.target_from_source.scale == pytest.approx(expected)
    assert fitted.scale_sigma == pytest.approx(1 / np.sqrt(1 / 1e-4 + 1 / 4e-4))


def test_sources_that_contradict_each_other_are_refused_in_one_line() -> None:
    rng = np.random.default_rng(9)
    flight = survey(strips(40), rng)
    wrong = ScaleConstraint(
        name="known distance", metres_per_unit=2 * flight.enu_from_scene.scale, sigma_log=0.01
    )
    with pytest.raises(BadInputError, match=r"known distance gives .* sigma apart") as refusal:
        fit_similarity([flight.fixes, wrong])
    assert "\n" not in str(refusal.value)
    sideways = UpConstraint(
        name="gimbal",
        up_in_source=flight.scene_from_enu.rotation @ [1.0, 0.0, 0.0],
        sigma_rad=np.radians(0.5),
    )
    with pytest.raises(BadInputError, match=r"gimbal has up (89|9\d)\.\d deg"):
        fit_similarity([flight.fixes, sideways])


@pytest.mark.parametrize(
    ("count", "message"), [(2, "at least 3"), (0, "at least 3")], ids=["two", "none"]
)
def test_too_few_fixes_are_refused(count: int, message: str) -> None:
    fixes = survey(strips(10), np.random.default_rng(1)).fixes
    few = {
        name: value[:count] if isinstance(value, np.ndarray) else value
        for name, value in vars(fixes).items()
    }
    with pytest.raises(BadInputError, match=message):
        fit_similarity([PositionConstraint(**few)])


def test_four_fixes_that_miss_their_stated_sigma_widen_it() -> None:
    fixes = survey(strips(4), np.random.default_rng(6), sigmas_m=np.full(3, 2.0)).fixes
    stated = PositionConstraint(**vars(fixes) | {"sigmas_m": np.full((4, 3), 0.02)})
    fitted = fit_similarity([stated])
    assert fitted.sources[0].sigma > 0.1
    assert fitted.scale_sigma > 0.002


def test_nothing_and_a_resting_camera_are_refused() -> None:
    with pytest.raises(BadInputError, match="nothing is known"):
        fit_similarity([])
    fixes = survey(np.tile([[1.0, 2.0, 3.0]], (9, 1)), np.random.default_rng(1)).fixes
    with pytest.raises(BadInputError, match="same point"):
        fit_similarity([fixes])


def test_the_origin_may_be_of_any_float() -> None:
    place = np.array([47.2, 8.5, 450.0])
    exact = Georeference.from_origin(place, HeightDatum.ELLIPSOID, "o")
    loose = replace(exact, lat_deg=place[0], lon_deg=place[1], height_m=place[2])
    point = [[30.0, -20.0, 10.0]]
    np.testing.assert_array_equal(loose.lat_lon_height(point), exact.lat_lon_height(point))
