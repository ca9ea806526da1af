"""Files that would crash, hang or fill the memory of a reader: each is refused in one line."""

import io
import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from geometry.camera import Camera
from geometry.colmap_files import FILES, check_colmap_files
from geometry.errors import BadInputError
from geometry.named_poses import read_camera
from geometry.npz import open_arrays, read_npz, save_arrays
from geometry.pose_files import read_poses, write_colmap_model, write_transforms_json, write_tum
from geometry.trajectory import CLOSEST, FARTHEST, Trajectory

CAMERA = Camera(model="PINHOLE", width=320, height=240, params=(300.0, 300.0, 159.5, 119.5))


def path_of_cameras(scale: float = 1.0, covariance: float | None = None) -> Trajectory:
    """Four cameras in a row, a step of `scale` apart."""
    translations = np.zeros((4, 3))
    translations[:, 0] = -np.arange(4) * scale
    return Trajectory(
        camera=CAMERA,
        indices=np.arange(4),
        times_s=np.arange(4.0),
        rotations=np.tile(np.eye(3), (4, 1, 1)),
        translations=translations,
        covariances=None if covariance is None else np.tile(np.eye(6) * covariance, (4, 1, 1)),
    )


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model")
    write_colmap_model(path_of_cameras(), np.eye(3), folder)
    assert {path.name for path in folder.iterdir()} >= set(FILES)
    return folder


def copy_of(model: Path, folder: Path) -> Path:
    for name in FILES:
        (folder / name).write_bytes((model / name).read_bytes())
    return folder


@pytest.mark.parametrize("name", FILES)
def test_a_colmap_file_cut_at_any_byte_is_refused(model: Path, tmp_path: Path, name: str) -> None:
    copy_of(model, tmp_path)
    check_colmap_files(tmp_path)
    content = (model / name).read_bytes()
    for end in range(len(content)):
        (tmp_path / name).write_bytes(content[:end])
        with pytest.raises(BadInputError, match=name):
            check_colmap_files(tmp_path)
    with pytest.raises(BadInputError, match="export the model again"):
        read_poses(tmp_path)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("count", [2**32, 2**63, 2**64 - 1])
def test_a_colmap_file_that_declares_too_much_is_refused(
    model: Path, tmp_path: Path, name: str, count: int
) -> None:
    copy_of(model, tmp_path)
    content = bytearray((model / name).read_bytes())
    content[:8] = struct.pack("<Q", count)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInputError, match="cut short"):
        read_poses(tmp_path)


def test_an_image_that_declares_too_many_points_is_refused(model: Path, tmp_path: Path) -> None:
    copy_of(model, tmp_path)
    content = bytearray((model / "images.bin").read_bytes())
    content[-8:] = struct.pack("<Q", 2**60)
    (tmp_path / "images.bin").write_bytes(content)
    with pytest.raises(BadInputError, match="cut short"):
        read_poses(tmp_path)


def test_a_whole_colmap_model_is_read(model: Path) -> None:
    assert np.allclose(read_poses(model).translations, path_of_cameras().translations)


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 200_000, "[" * 5000 + "]" * 5000])
def test_deep_json_is_refused_by_every_reader(tmp_path: Path, text: str) -> None:
    path = tmp_path / "deep.json"
    path.write_text(text)
    for read in (read_poses, Trajectory.load, lambda path: read_camera(path, 320, 240)):
        with pytest.raises(BadInputError, match=r"deep\.json"):
            read(path)


@pytest.mark.parametrize("scale", [1e300, 1e50, 2 * FARTHEST, CLOSEST / 10, 1e-9, 1e-300])
def test_poses_no_camera_had_are_refused_in_every_format(tmp_path: Path, scale: float) -> None:
    poses = path_of_cameras(scale)
    poses.save(tmp_path / "trajectory.json")
    write_transforms_json(poses, tmp_path / "transforms.json")
    write_tum(poses, tmp_path / "poses.txt")
    write_colmap_model(poses, np.eye(3), tmp_path / "model")
    for name in ("trajectory.json", "transforms.json", "poses.txt", "model"):
        with pytest.raises(BadInputError, match=f"{name}: .*(metres)") as refused:
            read_poses(tmp_path / name, CAMERA)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("scale", [0.0, 1e-3, 1.0, 1e4])
def test_poses_of_usual_units_are_read(tmp_path: Path, scale: float) -> None:
    poses = path_of_cameras(scale)
    poses.save(tmp_path / "trajectory.json")
    assert np.allclose(read_poses(tmp_path / "trajectory.json").translations, poses.translations)


def test_an_absurd_covariance_is_refused(tmp_path: Path) -> None:
    path_of_cameras(covariance=1e200).save(tmp_path / "trajectory.json")
    with pytest.raises(BadInputError, match="covariance"):
        Trajectory.load(tmp_path / "trajectory.json")


def npy(shape: tuple[int, ...], body: bytes) -> bytes:
    """A .npy of float64 that declares a shape."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    return stream.getvalue() + body


def write_zip(path: Path, name: str, content: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)


def refuse(path: Path, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        read_npz(path)

    def open_one() -> None:
        with open_arrays(path, "an archive") as file:
            assert file["a"] is not None

    with pytest.raises(BadInputError, match=message):
        open_one()


@pytest.mark.parametrize("shape", [(10**12,), (2**31, 2**31), (2**62, 8), (5,)])
def test_an_array_that_declares_another_size_is_refused(
    tmp_path: Path, shape: tuple[int, ...]
) -> None:
    write_zip(tmp_path / "a.npz", "a.npy", npy(shape, bytes(32)))
    refuse(tmp_path / "a.npz", "another size than it declares")


def test_an_archive_that_declares_more_than_it_can_hold_is_refused(tmp_path: Path) -> None:
    write_zip(tmp_path / "a.npz", "a.npy", npy((4,), bytes(32)))
    content = bytearray((tmp_path / "a.npz").read_bytes())
    entry = content.rindex(b"PK\x01\x02")
    content[entry + 24 : entry + 28] = struct.pack("<I", 2**32 - 2)
    (tmp_path / "a.npz").write_bytes(content)
    refuse(tmp_path / "a.npz", "declares more than the file holds")


def test_a_small_archive_of_huge_arrays_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("geometry.npz.MOST_BYTES", 1000)
    save_arrays(tmp_path / "a.npz", a=np.zeros(200))
    refuse(tmp_path / "a.npz", "takes more than")
    save_arrays(tmp_path / "b.npz", a=np.zeros(100), b=np.zeros(100))
    with pytest.raises(BadInputError, match="take more than"):
        read_npz(tmp_path / "b.npz")


@pytest.mark.parametrize("name", ["a.txt", "a"])
def test_an_archive_of_anything_else_is_refused(tmp_path: Path, name: str) -> None:
    write_zip(tmp_path / "a.npz", name, b"text")
    refuse(tmp_path / "a.npz", "is no array")


def test_a_bare_array_that_declares_too_much_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(npy((10**12,), b""))
    refuse(tmp_path / "a.npz", "a.npz")


def test_an_array_cut_at_any_byte_is_refused(tmp_path: Path) -> None:
    save_arrays(tmp_path / "whole.npz", a=np.arange(30.0), b=np.array(3))
    assert set(read_npz(tmp_path / "whole.npz")) == {"a", "b"}
    content = (tmp_path / "whole.npz").read_bytes()
    for end in range(len(content)):
        (tmp_path / "a.npz").write_bytes(content[:end])
        with pytest.raises(BadInputError):
            read_npz(tmp_path / "a.npz")


def test_json_that_is_merely_nested_is_read(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(json.dumps({"camera": CAMERA.to_dict()}))
    assert read_camera(tmp_path / "camera.json", 320, 240) == CAMERA
