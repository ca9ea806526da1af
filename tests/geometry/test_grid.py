"""The voxel grid against the projection of single points."""

import numpy as np

from geometry.camera import Camera
from geometry.grid import VoxelBox, sum_evidence
from geometry.trajectory import Trajectory

CAMERA = Camera.pinhole(64, 48, 60.0)


def two_views() -> Trajectory:
    turned = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
    return Trajectory(
        camera=CAMERA,
        indices=np.arange(2),
        times_s=np.arange(2.0),
        rotations=np.stack([np.eye(3), turned]),
        translations=np.array([[0.1, -0.2, 6.0], [0.5, 0.3, 7.0]]),
    )


def test_slices_meet_the_pixels_that_their_voxels_project_to() -> None:
    box = VoxelBox.from_corners(np.array([-1.0, -1.5, -0.7]), np.array([1.0, 1.5, 0.9]), longest=6)
    trajectory = two_views()
    zyx = np.argwhere(np.ones(box.shape)).astype(float)
    for i in range(2):
        homographies = box.pixels_from_slices(trajectory, i)
        mapped = np.stack([homographies[int(z)] @ [x, y, 1] for z, y, x in zyx])
        in_cam = trajectory.world_to_cam(i, box.centers_in_world(zyx))
        np.testing.assert_allclose(mapped[:, 2], in_cam[:, 2], atol=1e-12)
        np.testing.assert_allclose(
            mapped[:, :2] / mapped[:, 2:], trajectory.camera.project(in_cam), atol=1e-9
        )


def test_a_voxel_holds_what_the_views_say_where_it_is_seen() -> None:
    trajectory = two_views()
    llr = np.zeros((2, 48, 64), np.float32)
    seen = np.rint([trajectory.project(i, np.zeros((1, 3)))[0] for i in range(2)]).astype(int)
    for i, (x, y) in enumerate(seen):
        llr[i, y - 3 : y + 4, x - 3 : x + 4] = 1.0
    box = VoxelBox.from_corners(np.full(3, -0.05), np.full(3, 0.05), longest=1)
    far = np.full_like(llr, 1e-3)
    assert sum_evidence(box, trajectory, llr, far).llr[0, 0, 0] == 2.0
    near = np.full_like(llr, 1.0)
    assert sum_evidence(box, trajectory, llr, near).weight[0, 0, 0] == 0.0
