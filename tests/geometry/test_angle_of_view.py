"""Lenses that see more than a flat picture holds are refused by name, however they are given."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from geometry.angle_of_view import angle_of_view_deg, refuse_wide_lens
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.named_poses import read_camera
from geometry.pose_files import read_named_poses
from locate.messages.camera_info import camera_from_info

SIZE = (640, 480)


def fisheye(angle_deg: float) -> Camera:
    """An equidistant lens of this angle between the left and the right edge."""
    focal_px = (SIZE[0] - 1) / np.radians(angle_deg)
    params = (focal_px, focal_px, 319.5, 239.5, 0, 0, 0, 0)
    return Camera(model="OPENCV_FISHEYE", width=SIZE[0], height=SIZE[1], params=params)


@pytest.mark.parametrize("angle_deg", [40.0, 90.0, 119.0, 140.0, 175.0])
def test_angles_of_fisheye_and_pinhole_agree(angle_deg: float) -> None:
    focal_px = (SIZE[0] - 1) / 2 / np.tan(np.radians(angle_deg / 2))
    assert angle_of_view_deg(fisheye(angle_deg)) == pytest.approx(angle_deg, abs=0.1)
    pinhole = Camera.pinhole(*SIZE, focal_px)
    assert angle_of_view_deg(pinhole) == pytest.approx(angle_deg, abs=0.1)


@pytest.mark.parametrize("angle_deg", [121.0, 150.0, 185.0, 220.0, 270.0, 350.0])
def test_wide_lenses_are_refused(angle_deg: float) -> None:
    with pytest.raises(BadInputError, match="wide lenses beyond 120 degrees are not supported"):
        refuse_wide_lens(fisheye(angle_deg))
    refuse_wide_lens(fisheye(119.0))


def test_wide_cameras_are_refused_where_they_are_read(tmp_path: Path) -> None:
    wide = fisheye(150.0)
    (tmp_path / "camera.json").write_text(json.dumps(wide.to_dict()))
    with pytest.raises(BadInputError, match=r"camera\.json: .*sees 150 degrees"):
        read_camera(tmp_path / "camera.json", *SIZE)
    info = SimpleNamespace(
        d=np.zeros(4),
        k=np.array([wide.params[0], 0, 319.5, 0, wide.params[1], 239.5, 0, 0, 1]),
        distortion_model="equidistant",
        width=SIZE[0],
        height=SIZE[1],
        binning_x=0,
        binning_y=0,
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    )
    with pytest.raises(BadInputError, match="sees 150 degrees"):
        camera_from_info(info)


def test_wide_cameras_of_given_poses_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    frames = [{"file_path": f"{i}.jpg", "transform_matrix": np.eye(4).tolist()} for i in range(3)]
    lens = {"fl_x": 244.0, "w": 640, "h": 480, "is_fisheye": True, "k1": 0.01, "frames": frames}
    path.write_text(json.dumps(lens))
    named = read_named_poses(path)
    with pytest.raises(BadInputError, match="beyond 120 degrees"):
        named.match_to_frames(["0.jpg", "1.jpg"], np.arange(2), np.arange(2.0), size=SIZE)
