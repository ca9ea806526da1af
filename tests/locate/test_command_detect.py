"""`locate detect`: from images of any kind to files and pictures; and dybs within a run."""

import json
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from detect.bos import temporal_median
from detect.detection import Detection, Detector, Frames
from detect.registry import KINDS, DetectorChoice, make_detector
from detect.response import Response
from geometry.atomic import atomic_path
from geometry.errors import BadInputError
from geometry.npz import read_npz
from locate.commands.detect import detect
from locate.export.pictures import displacement_picture, overlay_evidence
from locate.pipeline.config import RunConfig
from locate.pipeline.frame_by_frame import detect_frames
from locate.pipeline.run import Run
from locate.recording.images import read_grey
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.recording.writer import LOSSLESS, create_video

BLOB = np.s_[10:20, 30:45]


class Blob:
    """Sees a plume of 0.4 px in one place of every frame, and nothing at the frame's left."""

    name = "blob"
    response: Response | None = None
    uses_other_frames = False

    def detect(self, frames: Frames, index: int) -> Detection:
        shape = frames.images[index].shape
        displacement = np.zeros((*shape, 2), np.float32)
        displacement[BLOB] = (0.4, 0.0)
        llr = np.full(shape, -1.0, np.float32)
        llr[BLOB] = 4.0
        llr[:, :8] = 0.0
        sigma_px = np.where(llr == 0, np.inf, 0.05).astype(np.float32)
        return Detection(displacement=displacement, sigma_px=sigma_px, llr=llr)


def texture(seed: int = 0, shape: tuple[int, int] = (48, 64)) -> np.ndarray:
    return np.random.default_rng(seed).integers(40, 90, shape, dtype=np.uint8)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in range(5):
        cv2.imwrite(str(folder / f"p{i}.png"), texture(i))
    return folder


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "video.mkv"
    with create_video(path, size=(64, 48), fps=12, codec=LOSSLESS) as writer:
        for i in range(6):
            writer.write(texture(i))
    return path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != ".lock")


@pytest.mark.parametrize("given", ["camera", "poses"])
def test_poses_that_are_none_are_named_before_frames_are_read(
    video: Path, tmp_path: Path, given: str
) -> None:
    files = {"poses": tmp_path / "a.json", given: tmp_path / "b.json"}
    for path in files.values():
        path.write_text("{}")
    with pytest.raises(BadInputError, match=r"b\.json"):
        detect_frames(video, tmp_path / "out", Blob(), **files)
    assert not (tmp_path / "out").exists()


def test_folder_gives_every_file(photos: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    seen = detect_frames(photos, output, Blob())
    assert names(output) == ["detections", "index.json", "masks", "overlay.mp4", "pictures"]
    stems = [f"p{i}" for i in range(5)]
    assert [one.frame for one in seen] == stems
    for folder, suffix in (("detections", ".npz"), ("masks", ".png"), ("pictures", ".png")):
        assert names(output / folder) == [stem + suffix for stem in stems]
    mask = cv2.imread(str(output / "masks/p3.png"), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(mask)) == {0, 255}
    assert (mask[BLOB] == 255).all()
    assert (mask > 0).sum() == 150
    saved = Detection.load(output / "detections/p3.npz")
    assert saved.displacement[15, 40] == pytest.approx((0.4, 0.0), abs=1e-3)
    assert seen[0].largest_px == pytest.approx(0.4)
    assert seen[0].mask_share == pytest.approx(150 / (48 * 64))
    assert seen[0].judged_share == pytest.approx(56 / 64)


def test_index_says_what_was_done(photos: Path, tmp_path: Path) -> None:
    detect_frames(photos, tmp_path / "out", Blob(), threshold_nats=1.5)
    index = json.loads((tmp_path / "out/index.json").read_text())
    assert index["schema"] == "locate.detections/1"
    assert (index["detector"], index["threshold_nats"]) == ("blob", 1.5)
    assert len(index["frames"]) == 5


def test_overlay_video_opens_in_another_reader(video: Path, tmp_path: Path) -> None:
    detect_frames(video, tmp_path / "out", Blob())
    reader = cv2.VideoCapture(str(tmp_path / "out/overlay.mp4"))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(12, rel=0.003)
    images = []
    while (read := reader.read())[0]:
        images.append(read[1].astype(int))
    assert len(images) == 6
    assert images[0].shape == (48, 64, 3)
    coloured = np.mean(images, axis=0)[..., 2] - np.mean(images, axis=0)[..., 0]
    assert coloured[13:17, 34:41].mean() > 60
    assert np.abs(coloured[30:]).mean() < 10


def test_every_second_frame_of_a_video(video: Path, tmp_path: Path) -> None:
    seen = detect_frames(video, tmp_path / "out", Blob(), every=2)
    assert [one.frame for one in seen] == ["000000", "000002", "000004"]
    assert names(tmp_path / "out/masks") == ["000000.png", "000002.png", "000004.png"]
    with av.open(str(tmp_path / "out/overlay.mp4")) as container:
        assert float(container.streams.video[0].average_rate or 0) == pytest.approx(6, rel=0.003)


def test_frames_between_those_measured_stay_neighbours(tmp_path: Path) -> None:
    detector = make_detector("registered-plain", neighbours=2)
    poses = SAMPLE / "truth.json"
    seen = detect_frames(SAMPLE_VIDEO, tmp_path / "out", detector, poses=poses, every=15)
    assert [one.frame for one in seen] == [f"{15 * i:06d}" for i in range(len(seen))]
    assert len(seen) > 1
    assert min(one.judged_share for one in seen) > 0.3


def test_reference_is_of_all_frames(photos: Path, tmp_path: Path) -> None:
    every = temporal_median([texture(i) for i in range(5)], 31)
    detector = make_detector("bos")
    detect_frames(photos, tmp_path / "out", detector, every=4)
    against_all = make_detector("bos", reference=every)
    detect_frames(photos, tmp_path / "all", against_all, every=4)
    for name in ("p0", "p4"):
        ours, wanted = (
            Detection.load(tmp_path / folder / f"detections/{name}.npz")
            for folder in ("out", "all")
        )
        assert (ours.displacement == wanted.displacement).all()


def test_one_image_of_odd_size_has_no_video(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.tif"), texture(shape=(51, 67)))
    detect_frames(tmp_path / "a.tif", tmp_path / "out", Blob())
    assert names(tmp_path / "out") == ["detections", "index.json", "masks", "pictures"]
    assert cv2.imread(str(tmp_path / "out/pictures/a.png")).shape == (51, 67, 3)


def test_odd_frames_still_make_a_video(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for i in range(2):
        cv2.imwrite(str(tmp_path / f"photos/{i}.png"), texture(i, (51, 67)))
    detect_frames(tmp_path / "photos", tmp_path / "out", Blob())
    assert cv2.VideoCapture(str(tmp_path / "out/overlay.mp4")).read()[1].shape == (50, 66, 3)


def test_photos_of_two_sizes_are_each_looked_at(photos: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(photos / "p9.png"), texture(shape=(60, 80)))
    assert len(detect_frames(photos, tmp_path / "out", Blob())) == 6
    assert not (tmp_path / "out/overlay.mp4").exists()


def test_a_photo_in_two_formats_is_measured_once(photos: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(photos / "p0.jpg"), texture())
    detect_frames(photos, tmp_path / "out", Blob())
    assert names(tmp_path / "out/masks") == [f"p{k}.png" for k in range(5)]


def test_folder_is_written_anew_but_only_its_own(photos: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    detect_frames(photos, output, Blob())
    (photos / "p4.png").unlink()
    detect_frames(photos, output, Blob())
    assert names(output / "masks") == ["p0.png", "p1.png", "p2.png", "p3.png"]
    with pytest.raises(BadInputError, match="another folder"):
        detect_frames(photos, photos, Blob())
    assert len(names(photos)) == 4


def test_failure_leaves_nothing_half_written(photos: Path, tmp_path: Path) -> None:
    (photos / "p3.png").write_bytes(b"no image")
    with pytest.raises(BadInputError, match=r"p3\.png"):
        detect_frames(photos, tmp_path / "out", Blob())
    left = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert {path.name for path in left} == {".lock", "index.json"}


def fail_half_way(path: Path) -> None:
    with atomic_path(path) as unfinished:
        unfinished.write_text("half")
        raise EOFError


def test_replacing_keeps_what_stood_there(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(EOFError):
        fail_half_way(path)
    assert names(tmp_path) == ["a.txt"]
    assert path.read_text() == "old"


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("kind", ["grey", "colour", "alpha"])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_any_depth_and_channels_read_alike(
    tmp_path: Path, bits: int, kind: str, suffix: str
) -> None:
    grey = np.linspace(0, (1 << bits) - 1, 40 * 50).reshape(40, 50)
    image = grey.astype(np.uint8 if bits == 8 else np.uint16)
    planes = {"grey": image, "colour": np.dstack([image] * 3), "alpha": np.dstack([image] * 4)}
    path = tmp_path / f"a.{suffix}"
    cv2.imwrite(str(path), planes[kind])
    expected = grey / (1 << bits) * 256
    assert np.abs(read_grey(path) - expected.clip(0, 255)).max() <= 1.01


def test_floating_point_image_is_read(tmp_path: Path) -> None:
    rising = np.tile(np.linspace(-3, 5, 64, dtype=np.float32), (48, 1))
    cv2.imwrite(str(tmp_path / "a.tif"), rising)
    shown = read_grey(tmp_path / "a.tif")[0].astype(int)
    assert (np.diff(shown) >= 0).all()
    assert np.ptp(shown) > 200


def hue_deg(displacement: tuple[float, float]) -> float:
    field = np.zeros((80, 80, 2), np.float32)
    field[60:] = displacement
    pixel = displacement_picture(field)[70:71, 40:41].astype(np.float32) / 255
    return float(cv2.cvtColor(pixel, cv2.COLOR_BGR2HSV)[0, 0, 0])


def test_hue_is_the_direction() -> None:
    assert hue_deg((0.3, 0.0)) == pytest.approx(0, abs=1)
    assert hue_deg((0.0, 0.3)) == pytest.approx(90, abs=1)
    assert hue_deg((-0.3, 0.0)) == pytest.approx(180, abs=1)
    assert hue_deg((0.0, -0.3)) == pytest.approx(270, abs=1)


def test_saturation_is_the_size_and_the_corner_its_largest() -> None:
    field = np.zeros((100, 100, 2), np.float32)
    field[50:, :50, 0], field[50:, 50:, 0] = 0.2, 0.4
    picture = displacement_picture(field)
    half, full = picture[70, 20].astype(int), picture[70, 70].astype(int)
    assert full.tolist() == [0, 0, 255]
    assert half == pytest.approx((128, 128, 255), abs=2)
    assert (picture[45] == 255).all()
    doubled = displacement_picture(2 * field)
    assert (doubled[20:] == picture[20:]).all()
    assert (doubled[:20] != picture[:20]).any()


def test_picture_of_nothing_measured_is_white() -> None:
    field = np.full((64, 64, 2), np.nan, np.float32)
    assert (displacement_picture(field)[30:] == 255).all()


def test_overlay_shows_the_frame_where_nothing_speaks_for_a_plume() -> None:
    image = texture()
    llr = np.full(image.shape, -1.0, np.float32)
    llr[BLOB] = 4.0
    picture = overlay_evidence(image, llr, 4.0)
    assert (picture[30:] == image[30:, :, None]).all()
    assert (picture[BLOB][..., 2] > 200).all()


def typed(*arguments: object) -> Result:
    app = typer.Typer()
    app.command()(detect)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_command_prints_what_it_saw(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(KINDS, "dybs", replace(KINDS["dybs"], build=lambda *_: Blob()))
    result = typed(photos, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "Evidence in 5 of 5 frames" in result.output
    assert "0.40 px" in result.output


def test_command_with_a_reference(tmp_path: Path) -> None:
    y, x = np.mgrid[:96, :128]
    still = (128 + 50 * np.sin(x / 1.6) * np.cos(y / 1.7)).astype(np.uint8)
    moved = (128 + 50 * np.sin((x + 0.5) / 1.6) * np.cos(y / 1.7)).astype(np.uint8)
    seen = np.where((np.abs(x - 64) < 24) & (np.abs(y - 48) < 24), moved, still)
    for name, image in (("still", still), ("seen", seen)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    arguments = ("--detector", "bos", "--reference", tmp_path / "still.png")
    result = typed(tmp_path / "seen.png", "-o", tmp_path / "out", *arguments)
    assert result.exit_code == 0, result.output
    w = read_npz(tmp_path / "out/detections/seen.npz")["displacement"].astype(float)
    assert w[40:56, 56:72, 0].mean() == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("detector", ["bos", "registered"])
def test_command_with_too_little_says_what_is_missing(
    photos: Path, tmp_path: Path, detector: str
) -> None:
    source = photos / "p0.png" if detector == "bos" else photos
    result = typed(source, "-o", tmp_path / "out", "--detector", detector)
    assert isinstance(result.exception, BadInputError)
    assert "\n" not in str(result.exception)


def test_without_weights_dybs_says_so_and_auto_does_not_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_dybs(tmp_path / "none.onnx", monkeypatch)
    with pytest.raises(BadInputError, match="no weights installed"):
        make_detector("dybs")
    with pytest.raises(BadInputError, match="no weights installed"):
        Run(RunConfig(recording=SAMPLE_VIDEO, detector="dybs"), tmp_path / "out")
    assert names(tmp_path) == []
    assert asked_of_run(tmp_path / "auto", monkeypatch) == "registered"


def test_with_weights_auto_lets_dybs_help(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = tmp_path / "some.onnx"
    weights.write_bytes(b"weights")
    install_dybs(weights, monkeypatch)
    assert asked_of_run(tmp_path / "out", monkeypatch) == "registered+dybs"
    stamp = json.loads((tmp_path / "out/.stages/detections.json").read_text())["fingerprint"]
    assert asked_of_run(tmp_path / "out", monkeypatch) == ""
    weights.write_bytes(b"others")
    assert asked_of_run(tmp_path / "out", monkeypatch) == "registered+dybs"
    assert json.loads((tmp_path / "out/.stages/detections.json").read_text())[
        "fingerprint"
    ] != stamp  # fmt: skip


def install_dybs(weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, "dybs", replace(KINDS["dybs"], installed_weights=weights))


def asked_of_run(output: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Which detector a run asks for to look at its frames; none where they were looked at."""
    asked = [""]

    def make(choice: DetectorChoice, **_: object) -> Detector:
        asked.append(choice.name)
        return Blob()

    monkeypatch.setattr(DetectorChoice, "make", make)
    config = RunConfig(
        recording=SAMPLE_VIDEO, poses=SAMPLE / "truth.json", max_frames=8, detection_frames=2
    )
    Run(config, output).run()
    return asked[-1]


def test_weights_of_another_detector_are_refused(tmp_path: Path) -> None:
    config = RunConfig(recording=SAMPLE_VIDEO, detector="bos", weights=tmp_path / "a.onnx")
    with pytest.raises(BadInputError, match="bos has no weights"):
        Run(config, tmp_path / "out")


def posed(photos: Path, count: int) -> Path:
    """A transforms.json of the first photos."""
    frames = [
        {"file_path": f"p{i}.png", "transform_matrix": np.eye(4).tolist()} for i in range(count)
    ]
    block = {"fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48}
    path = photos.parent / "transforms.json"
    path.write_text(json.dumps({**block, "frames": frames}))
    return path


def test_frames_without_a_pose_are_counted(photos: Path, tmp_path: Path) -> None:
    summaries = detect_frames(photos, tmp_path / "out", Blob(), poses=posed(photos, 3))
    assert len(summaries) == 3
    notes = json.loads((tmp_path / "out" / "index.json").read_text())["notes"]
    assert notes[0].startswith("2 of 5 frames have no pose in transforms.json")
    assert "could not be held against the images" in notes[1]


def test_a_frame_of_another_size_than_the_poses_is_named(photos: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(photos / "p2.png"), texture(2, (60, 80)))
    with pytest.raises(BadInputError, match=r"p2.png: 80x60 px, where the poses' camera"):
        detect_frames(photos, tmp_path / "out", Blob(), poses=posed(photos, 5))
