"""Small inputs after public bug reports of other tools (../shared/cases): the right value of each.

The recordings are the bundled sample, reduced to 320x240, and changed as their README says.
"""

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from geometry.pose_files import read_named_poses
from geometry.trajectory import Trajectory
from locate.pipeline.known_lengths import KnownLengths
from locate.pipeline.place import place_reconstruction
from locate.recording import KeyFrames, open_recording, select_frames
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.telemetry import read_telemetry
from locate.telemetry.track import AltitudeDatum

SIZE = (320, 240)
CODED = 3.0
"""Mean difference, in grey levels, up to which a picture is the sample's, coded with losses."""


@pytest.fixture
def cases() -> Path:
    """The folder of small inputs, which is no part of the repository."""
    folder = Path(__file__).parents[2] / "../shared/cases"
    if not folder.is_dir():
        pytest.skip(f"the small inputs are not here ({folder.resolve()})")
    return folder.resolve()


@cache
def sample_images() -> tuple[GreyImage, ...]:
    images = (frame.image for frame in open_recording(SAMPLE_VIDEO).frames())
    return tuple(cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA) for image in images)


def images_of(path: Path) -> Iterator[GreyImage]:
    return (frame.image for frame in open_recording(path).frames())


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a.astype(float) - b).mean())


def chosen(path: Path, folder: Path) -> KeyFrames:
    return select_frames(open_recording(path, one_camera=True), folder / "frames")


def truth() -> Trajectory:
    return Trajectory.load(SAMPLE / "truth.json")


@pytest.mark.parametrize(
    ("name", "positions", "heights_m"),
    [
        ("autel_srt/autel1.srt", [(-33.6323, -117.9605), (-33.6322, -117.9604)], [37.0, 37.1]),
        ("autel_srt/autel2.srt", [(60.1723, 24.9405), (60.1722, 24.9404)], [37.0, 37.1]),
        (
            "srt_lat_lon_alt/avata.srt",
            [(48.137154, 11.575382), (48.137155, 11.575383)],
            [569.8, 569.9],
        ),
        ("csv_decimal_comma/german4.csv", [(48.1234, 11.5678), (48.1235, 11.5679)], [512.4, 512.5]),
        ("csv_hemisphere/exifref.csv", [(-33.8688, -70.6483), (-33.8689, -70.6484)], [-100, -101]),
        ("csv_sourcefile/exiftool.csv", [(46.842778, -91.9943), (46.842433, -91.994333)], None),
        ("csv_clock_time/hhmmss.csv", [(48.1, 11.5), (48.1001, 11.5)], [500.0, 500.0]),
    ],
)
def test_positions(
    cases: Path, name: str, positions: list[tuple[float, float]], heights_m: list[float] | None
) -> None:
    track = read_telemetry(cases / name)
    found = np.stack([track.latitude_deg, track.longitude_deg], axis=1)[: len(positions)]
    np.testing.assert_allclose(found, positions, rtol=0, atol=1e-6)
    if heights_m is not None:
        np.testing.assert_allclose(track.altitude_m[: len(heights_m)], heights_m)
    assert track.warnings == ()


def test_times_of_day(cases: Path) -> None:
    track = read_telemetry(cases / "csv_clock_time/hhmmss.csv")
    assert track.times_s is not None
    np.testing.assert_allclose(track.times_s, [0, 1, 2, 3])


def test_photos_by_their_source_file(cases: Path) -> None:
    track = read_telemetry(cases / "csv_sourcefile/exiftool.csv")
    assert track.rows_of(["DJI_0029.JPG", "DJI_0020.JPG", "DJI_0001.JPG"]).tolist() == [1, 0, -1]


def test_a_stream_that_starts_late_meets_its_subtitles(cases: Path, tmp_path: Path) -> None:
    frames = chosen(cases / "ts_start_offset/qt.ts", tmp_path)
    np.testing.assert_allclose(frames.times_s, frames.indices / 15, atol=0.02)
    cameras = truth().take(frames.indices)
    placement = place_reconstruction(
        cameras, frames, [cases / "ts_start_offset/qt.SRT"], asked=True
    )
    assert placement.alignment is not None
    assert placement.notes == ()
    moved = placement.apply(cameras).centers_in_world
    np.testing.assert_allclose(
        moved - moved.mean(axis=0),
        20 * (cameras.centers_in_world - cameras.centers_in_world.mean(axis=0)),
        atol=0.5,
    )
    assert placement.georeference is not None
    place = placement.georeference.lat_lon_height(moved)
    assert np.abs(place[:, 0] + 16.901).max() < 0.003
    assert (np.abs(np.abs(place[:, 1]) - 180) < 0.003).all()


@pytest.mark.parametrize("name", ["black1.mp4", "fade.mp4"])
def test_a_first_frame_that_shows_nothing_is_no_rest(
    cases: Path, tmp_path: Path, name: str
) -> None:
    frames = chosen(cases / "black_first_frame" / name, tmp_path)
    assert not frames.static
    assert 0 not in frames.indices
    assert "show too little" in frames.warnings[0]


def test_a_second_shot_is_told(cases: Path, tmp_path: Path) -> None:
    frames = chosen(cases / "scene_cut/cut2.mp4", tmp_path)
    assert frames.indices.max() == 39
    assert "24 frames of the others" in frames.warnings[0]


def test_pixels_that_are_not_square(cases: Path) -> None:
    shown = images_of(cases / "anamorphic_sar/sar43_240x240.mp4")
    assert max(map(difference, shown, sample_images())) < CODED


def test_a_display_matrix_that_mirrors(cases: Path) -> None:
    shown = list(images_of(cases / "mirror_matrix/mirror.mp4"))
    mirrored = [image[:, ::-1] for image in sample_images()]
    assert max(map(difference, shown, mirrored)) < CODED


def test_interlaced_frames(cases: Path, tmp_path: Path) -> None:
    path = cases / "interlaced/inter_320.MTS"
    frames = chosen(path, tmp_path)
    assert any("interlaced" in note for note in frames.warnings)
    np.testing.assert_allclose(frames.times_s[0], 0, atol=1e-6)
    fields = list(pairwise(sample_images()))[::2]
    for image, (even, odd) in zip(images_of(path), fields, strict=True):
        woven = even.copy()
        woven[1::2] = odd[1::2]
        combs = [np.abs(np.diff(each.astype(float), axis=0)).mean() for each in (image, woven)]
        assert combs[0] < combs[1]


def test_photos_of_two_zooms_are_no_one_camera(cases: Path, tmp_path: Path) -> None:
    frames = chosen(cases / "mixed_zoom_photos", tmp_path)
    assert [frame.source for frame in frames.frames] == [f"IMG_{2 * i:04d}.jpg" for i in range(18)]
    assert frames.focal_prior_px == pytest.approx(32 / 36 * 320)
    assert any("12 of 30 photos are left out" in note for note in frames.warnings)


def test_centikelvin_keep_their_levels(cases: Path) -> None:
    recording = open_recording(cases / "thermal16")
    assert recording.stretch is not None
    for image, known in zip(images_of(cases / "thermal16"), sample_images()[:5], strict=False):
        assert len(np.unique(image)) > 100
        assert np.corrcoef(image.ravel(), known.ravel())[0, 1] > 0.5
    assert sum("more than 8 bits" in note for note in recording.warnings) == 1


def test_clicks_outside_the_frame_set_no_scale(cases: Path, tmp_path: Path) -> None:
    lengths = KnownLengths.of(None, cases / "distance_clicks/d3.json")
    cameras = truth()
    names = [f"{index:06d}.png" for index in cameras.indices]
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(BadInputError, match=r"the click at \(900, 301\) px is outside 000004.png"):
        lengths.constrain_scale(cameras, tmp_path, names)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("colmap_trunc_frames", "not a whole file of a COLMAP model"),
        ("deep.json", "nested too deeply"),
        ("trajectory_1e300.json", r"over 1e\+09 units from the origin"),
    ],
)
def test_hostile_poses_are_refused(cases: Path, name: str, said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        read_named_poses(cases / "hostile" / name)


def test_hostile_telemetry(cases: Path) -> None:
    with pytest.raises(BadInputError, match="runs in circles"):
        read_telemetry(cases / "hostile/ulog_hang_146B.ulg")
    text = read_telemetry(cases / "hostile/exif_altitude_ascii.jpg")
    assert (text.latitude_deg[0], text.longitude_deg[0]) == (-46.51, -91.255)
    assert np.isnan(text.altitude_m[0])
    assert "no known form of a number" in text.warnings[0]
    angle = read_telemetry(cases / "hostile/exif_latitude_ascii.jpg")
    assert (angle.latitude_deg[0], angle.altitude_m[0]) == (-46.5, 198.25)
    assert angle.altitude_datum is AltitudeDatum.MEAN_SEA_LEVEL


BROWN = (-0.3, 0.1, 0.001, 0.002)
FISHEYE = (0.03, 0.005, 0.0006, 0.0001)
LENSES = {
    "a": ("OPENCV", BROWN),
    "b": ("FULL_OPENCV", (*BROWN, -0.05, 0, 0, 0)),
    "c": ("OPENCV_FISHEYE", FISHEYE),
    "d": ("OPENCV_FISHEYE", FISHEYE),
    "e": ("OPENCV", BROWN),
    "f": ("OPENCV", (-0.2, 0, 0, 0)),
    "full": ("PINHOLE", ()),
    "g": ("OPENCV", (-0.2, 0.01, 0, 0)),
    "k": ("FULL_OPENCV", (*BROWN, 0.1, 0.2, 0.1, 0.1)),
    "k2": ("THIN_PRISM_FISHEYE", (*BROWN, 0, 0, 0, 0)),
    "l": ("PINHOLE", ()),
    "m2": ("OPENCV", BROWN),
}
"""Model and terms of each transforms.json that is read."""
REFUSED_LENSES = {
    "h": "k1 = -0.2 is not understood with camera model PINHOLE",
    "i": "camera model 'EQUIRECTANGULAR' is not one of",
    "j": "camera model 'PERSPECTIVE' is not one of",
    "m": "3 cameras",
}


@pytest.mark.parametrize("name", LENSES)
def test_lenses_of_transforms_are_read_whole(cases: Path, name: str) -> None:
    path = cases / f"transforms_models/{name}.json"
    model, terms = LENSES[name]
    camera = read_named_poses(path).trajectory.camera
    assert camera.model == model
    focal_px = 560 if name == "full" else 500
    np.testing.assert_allclose(camera.params, (focal_px, focal_px, 319.5, 239.5, *terms))


@pytest.mark.parametrize("name", REFUSED_LENSES)
def test_lenses_of_transforms_that_are_not_known_are_refused(cases: Path, name: str) -> None:
    with pytest.raises(BadInputError, match=REFUSED_LENSES[name]):
        read_named_poses(cases / f"transforms_models/{name}.json")


def test_every_transforms_file_has_its_answer(cases: Path) -> None:
    names = {path.stem for path in (cases / "transforms_models").glob("*.json")}
    assert names == LENSES.keys() | REFUSED_LENSES.keys()
