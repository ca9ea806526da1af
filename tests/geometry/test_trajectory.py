"""Trajectories: geometry, world changes, covariances, and their file."""

import json
from pathlib import Path

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory


def random_trajectory(seed: int, n: int = 5) -> Trajectory:
    random = np.random.default_rng(seed)
    roots = random.normal(size=(n, 6, 6))
    return Trajectory(
        camera=Camera.pinhole(640, 480, 560.0),
        indices=np.arange(n) * 3,
        times_s=np.arange(n) / 7,
        rotations=Rotation.random(n, rng=random).as_matrix(),
        translations=random.normal(size=(n, 3)),
        covariances=roots @ np.swapaxes(roots, 1, 2),
        metric=True,
    )


def test_centers_are_where_the_camera_frame_is_zero() -> None:
    trajectory = random_trajectory(0)
    for i, center in enumerate(trajectory.centers_in_world):
        np.testing.assert_allclose(trajectory.world_to_cam(i, center), 0, atol=1e-12)


@given(st.integers(0, 1000))
@settings(deadline=None)
def test_pixels_do_not_depend_on_the_world_frame(seed: int) -> None:
    random = np.random.default_rng(seed)
    trajectory, points = random_trajectory(seed), random.normal(size=(7, 3)) * 4
    move = Similarity(
        scale=float(np.exp(random.normal())),
        rotation=Rotation.random(rng=random).as_matrix(),
        translation=random.normal(size=3),
    )
    moved = trajectory.transformed(move)
    for i in range(len(trajectory)):
        np.testing.assert_allclose(
            moved.project(i, move(points)), trajectory.project(i, points), rtol=1e-6, atol=1e-4
        )


def test_covariance_follows_the_world_as_gtsam_moves_it() -> None:
    """A right-tangent error of world_from_cam only feels the scale of a new world."""
    trajectory = random_trajectory(3)
    move = Similarity(
        scale=2.5, rotation=Rotation.from_rotvec([0.3, -1, 2]).as_matrix(), translation=np.ones(3)
    )
    moved = trajectory.transformed(move)

    def pose(t: Trajectory) -> gtsam.Pose3:
        return gtsam.Pose3(gtsam.Rot3(t.rotations[0].T), t.centers_in_world[0])

    def carried(error: np.ndarray) -> np.ndarray:
        old = pose(trajectory).retract(error)
        rotation = gtsam.Rot3(move.rotation @ old.rotation().matrix())
        return pose(moved).localCoordinates(gtsam.Pose3(rotation, move(old.translation())))

    step = 1e-6
    jacobian = np.column_stack([carried(step * axis) / step for axis in np.eye(6)])
    assert trajectory.covariances is not None
    assert moved.covariances is not None
    expected = jacobian @ trajectory.covariances[0] @ jacobian.T
    np.testing.assert_allclose(moved.covariances[0], expected, rtol=1e-4, atol=1e-4)


def test_take_keeps_rows_together() -> None:
    taken = random_trajectory(1).take([3, 1])
    assert taken.indices.tolist() == [9, 3]
    np.testing.assert_array_equal(taken.translations, random_trajectory(1).translations[[3, 1]])


def test_file_round_trip(tmp_path: Path) -> None:
    trajectory = random_trajectory(2)
    assert trajectory.covariances is not None
    trajectory.covariances[2] = np.nan
    trajectory.save(tmp_path / "trajectory.json")
    loaded = Trajectory.load(tmp_path / "trajectory.json")
    content = json.loads((tmp_path / "trajectory.json").read_text())
    np.testing.assert_allclose(loaded.rotations, trajectory.rotations, atol=1e-12)
    np.testing.assert_array_equal(loaded.translations, trajectory.translations)
    np.testing.assert_array_equal(loaded.covariances, trajectory.covariances)
    np.testing.assert_array_equal(loaded.indices, trajectory.indices)
    assert (loaded.metric, loaded.gravity, loaded.units) == (True, False, "m")
    assert content["frames"][2]["covariance"] is None


def test_empty_trajectory_round_trip() -> None:
    empty = random_trajectory(0).take([])
    assert len(Trajectory.from_dict(empty.to_dict())) == 0


def test_frames_are_put_in_order() -> None:
    content = random_trajectory(4).to_dict()
    content["frames"].reverse()
    found = Trajectory.from_dict(content)
    assert found.indices.tolist() == [0, 3, 6, 9, 12]
    np.testing.assert_array_equal(found.translations, random_trajectory(4).translations)


@pytest.mark.parametrize("schema", ["locate.trajectory/1", "locate.truth/1"])
def test_both_schemas_are_read(schema: str) -> None:
    assert len(Trajectory.from_dict(random_trajectory(4).to_dict() | {"schema": schema})) == 5


@pytest.mark.parametrize("schema", ["locate.trajectory/2", "locate.map/1", None])
def test_other_schemas_are_refused(schema: str | None) -> None:
    with pytest.raises(BadInputError, match=r"schema .* expected locate\.trajectory/1"):
        Trajectory.from_dict(random_trajectory(4).to_dict() | {"schema": schema})


def test_repeated_frames_are_refused() -> None:
    content = random_trajectory(4).to_dict()
    content["frames"][3]["index"] = 3
    with pytest.raises(BadInputError, match="frame 3 comes more than once"):
        Trajectory.from_dict(content)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("key", ["translation", "rotation_xyzw", "time_s"])
def test_poses_that_are_not_finite_are_refused(tmp_path: Path, key: str, value: float) -> None:
    content = random_trajectory(4).to_dict()
    frame = content["frames"][2]
    if key == "time_s":
        frame[key] = value
    else:
        frame["cam_from_world"][key][1] = value
    (tmp_path / "t.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"t\.json: (frame 6: .*finite|.*quat)"):
        Trajectory.load(tmp_path / "t.json")


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "nothing", '{"frames": 3}', '{"schema": "x", "frames": [{}], "units": "m"}'],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.json"
    path.write_text(text)
    with pytest.raises(BadInputError, match=r"t\.json") as caught:
        Trajectory.load(path)
    assert "\n" not in str(caught.value)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"gone\.json"):
        Trajectory.load(tmp_path / "gone.json")


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"rotations\.shape"):
        Trajectory(
            camera=Camera.pinhole(4, 4, 4.0),
            indices=np.arange(2),
            times_s=np.zeros(2),
            rotations=np.eye(3),
            translations=np.zeros((2, 3)),
        )
