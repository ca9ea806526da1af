"""Lists of poses in the variants that people bring: read exactly, or refused with the line."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.pose_files import read_named_poses
from geometry.pose_lists import read_pose_list

CAMERA = Camera.pinhole(64, 48, 60.0)
TURNS = Rotation.from_euler("xyz", [[10, 20, 30], [11, 18, 33], [12, 15, 35]], degrees=True)
PLACES = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, 3.0], [2.0, 3.0, 3.5]])
STAMPS_NS = [1403636579763555584 + 50_000_000 * i for i in range(3)]


def tum(between: str, *, w_first: bool = False, stamps: list[str] | None = None) -> str:
    quaternions = TURNS.as_quat(scalar_first=w_first)
    stamps = stamps or [str(0.5 * i) for i in range(3)]
    rows = zip(stamps, np.hstack([PLACES, quaternions]), strict=True)
    return "\n".join(between.join([stamp, *map(repr, row.tolist())]) for stamp, row in rows)


def ns() -> list[str]:
    return [str(stamp) for stamp in STAMPS_NS]


def kitti() -> str:
    matrices = np.concatenate([TURNS.as_matrix(), PLACES[:, :, None]], axis=2)
    return "\n".join(" ".join(map(repr, m.ravel().tolist())) for m in matrices)


VARIANTS = {
    "tum": tum(" "),
    "tabs": tum("\t"),
    "commas": tum(", "),
    "semicolons": tum(";"),
    "mark of UTF-8": "\ufeff" + tum(" "),
    "comment": "# timestamp tx ty tz qx qy qz qw\n" + tum(" ") + "\n# end\n",
    "header": "timestamp,tx,ty,tz,qx,qy,qz,qw\n" + tum(","),
    "header, w first": "stamp,x,y,z,qw,qx,qy,qz\n" + tum(",", w_first=True),
    "EuRoC": "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], "
    "q_RS_y [], q_RS_z []\n" + tum(",", w_first=True, stamps=ns()),
    "EuRoC without header": tum(",", w_first=True, stamps=ns()),
    "EuRoC with velocities": "\n".join(
        line + ",0.1,0.2,0.3" for line in tum(",", w_first=True, stamps=ns()).splitlines()
    ),
    "KITTI": kitti(),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_gives_the_same_poses(name: str, tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(VARIANTS[name], encoding="utf-8")
    found = read_pose_list(path)
    np.testing.assert_allclose(found.centers, PLACES)
    np.testing.assert_allclose(found.rotations, TURNS.inv().as_matrix(), atol=1e-12)
    assert (found.times_s is None) == (name == "KITTI")


REFUSED = {
    "nothing": ("# only a comment\n", "holds no poses"),
    "seven numbers": ("1 2 3 4 5 6 7\n", "line 1: 7 numbers"),
    "a word": (tum(" ") + "\n3.0 a b c d e f g\n", "line 4: not a pose"),
    "decimal commas": ("0,5 1,0 2,0 3,0 0,0 0,0 0,0 1,0\n", "line 1: 16 numbers"),
    "cut short": (tum(" ")[:-20], "line 3"),
    "Euler angles": ("0.0 1 2 3 10 20 30 0\n", "line 1: its quaternion"),
    "stamps in s after ns": (
        tum(",", w_first=True, stamps=[*ns()[:2], "0.5"]),
        "line 3: not a pose",
    ),
    "a stamp of 400 digits": (
        tum(",", w_first=True, stamps=["9" * 400, *ns()[1:]]),
        "line 1: not a pose",
    ),
    "a huge quaternion": ("0.0 1 2 3 0 0 1e300 1\n", "line 1: its quaternion"),
    "not finite": ("0.0 1 2 3 0 0 nan 1\n", "line 1: not a pose"),
    "unknown order": ("t,x,y,z,qx,qw,qy,qz\n" + tum(","), "unknown order"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_of_no_known_kind_is_refused(name: str, tmp_path: Path) -> None:
    text, reason = REFUSED[name]
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(BadInputError, match=reason):
        read_pose_list(path)


def test_photos_named_by_their_stamps_find_their_poses(tmp_path: Path) -> None:
    """As those of EuRoC; stamps of the second photo are not those of any pose."""
    path = tmp_path / "data.csv"
    path.write_text(tum(",", w_first=True, stamps=ns()))
    sources = [f"{STAMPS_NS[0]}.png", f"{STAMPS_NS[1] + 24_000_000}.png", f"{STAMPS_NS[2]}.png"]
    named = read_named_poses(path, CAMERA)
    found, rows = named.match_to_frames(sources, np.arange(3), np.arange(3.0))
    assert rows.tolist() == [0, 2]
    np.testing.assert_allclose(found.centers_in_world, PLACES[[0, 2]])
    assert found.times_s.tolist() == [0.0, 2.0]


def test_lines_of_kitti_are_those_of_the_frames(tmp_path: Path) -> None:
    path = tmp_path / "00.txt"
    path.write_text(kitti())
    found, rows = read_named_poses(path, CAMERA).match_to_frames(
        ["a.png", "b.png"], np.array([0, 2]), np.array([0.0, 0.2])
    )
    assert rows.tolist() == [0, 1]
    np.testing.assert_allclose(found.centers_in_world, PLACES[[0, 2]])
