"""Recordings and key frames: what is kept, and what is refused with one line."""

import struct
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.stream import Disposition

from geometry.errors import BadInputError
from locate.recording import KeyFrames, open_recording, select_frames
from locate.recording.focal import focal_of_photo, focal_of_video
from locate.recording.photo_groups import optics_of_photo
from locate.recording.writer import H264
from locate.simulation.compression import write_coded

WIDTH, HEIGHT, RATE = 320, 240, 20


def wallpaper(seed: int = 0, size: int = 900) -> np.ndarray:
    random = np.random.default_rng(seed)
    image = np.zeros((size, size), np.float32)
    for cells in (12, 40, 120, 300):
        coarse = random.normal(size=(cells, cells)).astype(np.float32)
        image += cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
    return cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def pan(shifts_px: list[float], blurred: set[int] = frozenset()) -> list[np.ndarray]:
    """Frames that slide over a wallpaper, with sensor noise."""
    paper, random = wallpaper(), np.random.default_rng(1)
    frames = []
    for i, shift in enumerate(shifts_px):
        matrix = np.array([[1, 0, -shift], [0, 1, -50]], float)
        frame = cv2.warpAffine(paper, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
        if i in blurred:
            frame = cv2.GaussianBlur(frame, (0, 0), 2.0)
        noisy = frame + random.normal(scale=1.0, size=frame.shape)
        frames.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return frames


def write_video(path: Path, frames: list[np.ndarray], pts: list[int] | None = None) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=RATE)
        stream.width, stream.height = frames[0].shape[1], frames[0].shape[0]
        stream.pix_fmt = "gray"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        for i, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts = pts[i] if pts else i * 1000 // RATE
            frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_photos(folder: Path, frames: list[np.ndarray], suffix: str = ".png") -> Path:
    folder.mkdir()
    for i, image in enumerate(frames):
        cv2.imwrite(str(folder / f"img{i + 1}{suffix}"), image)
    return folder


def keep(path: Path, tmp_path: Path, max_frames: int = 120) -> KeyFrames:
    recording = open_recording(path)
    return select_frames(recording, tmp_path / "frames", max_frames=max_frames, target_motion=0.015)


def test_even_orbit_keeps_every_frame(tmp_path: Path) -> None:
    kept = keep(write_video(tmp_path / "v.mkv", pan([5.0 * i for i in range(40)])), tmp_path)
    assert kept.indices.tolist() == list(range(40))
    assert not kept.static
    np.testing.assert_allclose([f.motion_px for f in kept.frames[1:]], 5.0, atol=0.2)


def test_slow_video_is_thinned_evenly(tmp_path: Path) -> None:
    frames = pan([1.2 * i for i in range(80)])
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path)
    motions = np.array([f.motion_px for f in kept.frames[1:]])
    assert 18 <= len(kept) <= 22
    assert np.all(np.abs(motions - 4.8) < 1.3)


def test_uneven_speed_gives_even_motion(tmp_path: Path) -> None:
    steps = np.r_[np.full(30, 0.5), np.zeros(20), np.full(40, 2.4)]
    kept = keep(write_video(tmp_path / "v.mkv", pan(list(np.cumsum(steps)))), tmp_path)
    motions = np.array([f.motion_px for f in kept.frames[1:]])
    assert motions.min() > 3.3
    assert motions.max() < 6.3


def test_sharper_of_near_equals_is_taken(tmp_path: Path) -> None:
    blurred = set(range(0, 60, 2))
    frames = pan([0.8 * i for i in range(60)], blurred)
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path)
    assert len(kept) >= 8
    assert not blurred & set(kept.indices[1:].tolist())


@pytest.mark.parametrize("max_frames", [120, 20])
def test_b_frames_are_kept_last(tmp_path: Path, max_frames: int) -> None:
    """Twice as many frames as are kept, three of four of them B frames or more."""
    images = pan([1.0 * i for i in range(120)])
    write_coded(tmp_path / "pan.mp4", images, 25.0, codec=H264, bits_per_pixel=0.2)
    recorded = list(open_recording(tmp_path / "pan.mp4").frames())
    share = np.mean([frame.is_b_frame for frame in recorded])
    kept = keep(tmp_path / "pan.mp4", tmp_path, max_frames=max_frames)
    assert share > 0.5
    assert np.mean([frame.is_b_frame for frame in kept.frames]) < 0.6 * share
    assert kept.b_frames.tolist() == [
        frame.index for frame in kept.frames if recorded[frame.index].is_b_frame
    ]
    kept.save(tmp_path / "index.json")
    assert KeyFrames.load(tmp_path / "index.json") == kept


def test_max_frames_spreads_over_the_path(tmp_path: Path) -> None:
    frames = pan([5.0 * i for i in range(60)])
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path, max_frames=20)
    gaps = np.diff(kept.indices)
    (note,) = kept.warnings
    assert "20 of 60 frames that its motion asks for are used" in note
    assert "--max-frames 60 uses all" in note
    assert len(kept) == 20
    assert kept.indices[0] == 0
    assert kept.indices[-1] == 59
    assert gaps.max() - gaps.min() <= 1


def test_still_camera_with_a_plume_is_static(tmp_path: Path) -> None:
    frames, random = pan([0.0] * 30), np.random.default_rng(2)
    for frame in frames:
        region = frame[60:140, 100:150]
        region[:] = np.roll(region, random.integers(-1, 2), axis=1)
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path, max_frames=20)
    assert kept.static
    assert len(kept) == 20
    assert np.diff(kept.times_s).std() < 0.03


def test_half_of_a_long_still_video_is_kept_in_a_row(tmp_path: Path) -> None:
    kept = keep(write_video(tmp_path / "v.mkv", pan([0.0] * 240)), tmp_path, max_frames=40)
    assert kept.static
    assert len(kept) == 40
    assert kept.indices[0] == 0
    gaps_s = np.diff(kept.times_s)
    assert np.count_nonzero(gaps_s <= 0.12) >= 19
    assert gaps_s.max() < 3 * 240 / 15 / 40
    assert "40 of 240 frames by a camera at rest are used" in kept.warnings[0]


def test_shaking_tripod_is_not_lost(tmp_path: Path) -> None:
    shifts = list(np.random.default_rng(3).normal(scale=1.5, size=40))
    kept = keep(write_video(tmp_path / "v.mkv", pan(shifts)), tmp_path)
    assert len(kept) == 40
    assert not kept.static


def faded(frame: np.ndarray, share: float) -> np.ndarray:
    return np.rint(frame * share).astype(np.uint8)


def grain(level: float) -> np.ndarray:
    noise = np.random.default_rng(5).normal(level, 3.0, (HEIGHT, WIDTH))
    return np.clip(noise, 0, 255).astype(np.uint8)


def empty_starts(frames: list[np.ndarray]) -> dict[str, list[np.ndarray]]:
    """The same frames with six that show too little before them, or the first fifteen faded in."""
    return {
        "black": [np.zeros_like(frames[0])] * 6 + frames,
        "white": [np.full_like(frames[0], 255)] * 6 + frames,
        "grain": [grain(8.0)] * 6 + frames,
        "blurred": [cv2.GaussianBlur(frames[0], (0, 0), 25)] * 6 + frames,
        "fade": [faded(frame, min(1.0, i / 15)) for i, frame in enumerate(frames)],
        "from white": [
            255 - faded(255 - frame, min(1.0, i / 15)) for i, frame in enumerate(frames)
        ],
    }


STARTS = ["black", "white", "grain", "blurred", "fade", "from white"]


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("moves", [True, False])
def test_stillness_is_not_told_by_frames_that_show_nothing(
    tmp_path: Path, start: str, moves: bool
) -> None:
    frames = pan([4.0 * i if moves else 0.0 for i in range(40)])
    kept = keep(write_video(tmp_path / "v.mkv", empty_starts(frames)[start]), tmp_path)
    assert kept.static is not moves
    (note,) = kept.warnings
    assert "left out because they show too little" in note
    if start not in {"fade", "from white"}:
        assert kept.indices[0] == 6
        assert note.startswith("6 of 46 frames")


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_recording_that_shows_nothing_is_refused(tmp_path: Path, grey: int) -> None:
    frames = [np.full((HEIGHT, WIDTH), grey, np.uint8)] * 20
    assert "show anything" in refused(write_video(tmp_path / "v.mkv", frames), tmp_path)


def test_a_black_photo_is_left_out(tmp_path: Path) -> None:
    frames = pan([20.0 * i for i in range(6)])
    frames[2] = np.zeros_like(frames[2])
    kept = keep(write_photos(tmp_path / "photos", frames), tmp_path)
    assert kept.indices.tolist() == [0, 1, 3, 4, 5]
    assert "img3.png" in kept.warnings[0]


def second_shot(count: int) -> list[np.ndarray]:
    return [frame[:, ::-1].copy() for frame in pan([4.0 * i for i in range(count)])]


def test_the_longest_of_several_shots_is_used(tmp_path: Path) -> None:
    first = pan([4.0 * i for i in range(30)])
    between = [np.zeros_like(first[0])] * 3
    frames = [*first, *second_shot(20), *between, *pan([200 + 3.0 * i for i in range(40)])]
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path)
    assert kept.indices.min() >= 53
    assert len(kept) >= 20
    (note,) = kept.warnings
    assert "3 shots, 0.00 to 1.45 s, 1.50 to 2.60 s, 2.65 to 4.60 s" in note
    assert "53 frames of the others" in note
    chosen = select_frames(
        open_recording(tmp_path / "v.mkv"), tmp_path / "chosen", shot=2, target_motion=0.015
    )
    assert 30 <= chosen.indices.min() < chosen.indices.max() <= 49
    assert "number 2, 1.50 to 2.60 s, is used, and 70 frames" in chosen.warnings[0]
    with pytest.raises(BadInputError, match="has no shot 4, only 1 to 3: 0"):
        select_frames(open_recording(tmp_path / "v.mkv"), tmp_path / "none", shot=4)


def test_a_mirrored_second_shot_is_told(tmp_path: Path) -> None:
    frames = [*pan([4.0 * i for i in range(40)]), *second_shot(24)]
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path)
    assert kept.indices.max() == 39
    assert "24 frames of the others" in kept.warnings[0]


@pytest.mark.parametrize("kind", ["flash", "darker", "brighter", "whip"])
def test_what_is_no_cut_is_taken_for_none(tmp_path: Path, kind: str) -> None:
    shifts = [4.0 * i for i in range(40)]
    if kind == "whip":
        shifts[20:] = [shift + 260 for shift in shifts[20:]]
        shifts[19:21] = [150.0, 280.0]
    frames = pan(shifts)
    gains = {"darker": 0.4, "brighter": 2.0}
    for i in range(20, 40):
        frames[i] = np.clip(frames[i] * gains.get(kind, 1.0), 0, 255).astype(np.uint8)
    if kind == "flash":
        frames[20:22] = [np.clip(f * 3.0 + 90, 0, 255).astype(np.uint8) for f in frames[20:22]]
    kept = keep(write_video(tmp_path / "v.mkv", frames), tmp_path)
    assert not any("shots" in note for note in kept.warnings)
    assert kept.indices.max() > 35


def test_written_frames_are_lossless_and_times_exact(tmp_path: Path) -> None:
    frames = pan([5.0 * i for i in range(12)])
    pts = [0, 40, 95, 130, 200, 260, 301, 352, 420, 480, 533, 600]
    kept = keep(write_video(tmp_path / "v.mkv", frames, pts), tmp_path)
    for frame in kept.frames:
        image = cv2.imread(str(tmp_path / "frames" / frame.name), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(image, frames[frame.index])
    np.testing.assert_allclose(kept.times_s, np.array(pts)[kept.indices] / 1000)


@pytest.mark.parametrize("first", ["small", "large"])
def test_the_largest_of_several_streams_is_used(tmp_path: Path, first: str) -> None:
    large = pan([5.0 * i for i in range(12)])
    small = [frame[: HEIGHT // 2, : WIDTH // 2] for frame in second_shot(12)]
    given = [small, large] if first == "small" else [large, small]
    path = tmp_path / "two.mkv"
    with av.open(str(path), "w") as container:
        streams = []
        for images in given:
            stream = container.add_stream("ffv1", rate=25)
            stream.height, stream.width = images[0].shape
            stream.pix_fmt = "gray"
            streams.append(stream)
        for i in range(12):
            for stream, images in zip(streams, given, strict=True):
                image = np.ascontiguousarray(images[i])
                container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        for stream in streams:
            container.mux(stream.encode(None))
    kept = keep(path, tmp_path)
    image = cv2.imread(str(tmp_path / "frames" / kept.names[0]), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, large[0])
    (note,) = kept.warnings
    assert f"holds 2 video streams; that of {WIDTH}x{HEIGHT} is used" in note


def test_a_cover_picture_is_no_recording(tmp_path: Path) -> None:
    path = tmp_path / "cover.mp4"
    images = pan([5.0 * i for i in range(12)])
    cover = np.ascontiguousarray(np.tile(images[0], (2, 2)))
    with av.open(str(path), "w") as container:
        sleeve = container.add_stream("mjpeg", rate=1)
        sleeve.height, sleeve.width = cover.shape
        sleeve.pix_fmt, sleeve.disposition = "yuvj420p", Disposition.attached_pic
        stream = container.add_stream("mpeg4", rate=25)
        stream.height, stream.width = images[0].shape
        stream.pix_fmt = "yuv420p"
        for target, frames in ((sleeve, [cover]), (stream, images)):
            for image in frames:
                frame = av.VideoFrame.from_ndarray(image, format="gray")
                container.mux(target.encode(frame.reformat(format=target.pix_fmt)))
            container.mux(target.encode(None))
    recording = open_recording(path)
    assert (recording.width, recording.height) == (WIDTH, HEIGHT)
    assert len(list(recording.frames())) == 12
    assert recording.warnings == []


def test_index_survives_its_file(tmp_path: Path) -> None:
    kept = keep(write_video(tmp_path / "v.mkv", pan([5.0 * i for i in range(12)])), tmp_path)
    kept.save(tmp_path / "index.json")
    assert KeyFrames.load(tmp_path / "index.json") == kept
    (tmp_path / "index.json").write_text('{"schema": "other"}')
    with pytest.raises(BadInputError, match="frame index"):
        KeyFrames.load(tmp_path / "index.json")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".webp"])
def test_photos_are_all_kept_in_natural_order(tmp_path: Path, suffix: str) -> None:
    folder = write_photos(tmp_path / "photos", pan([20.0 * i for i in range(11)]), suffix)
    (folder / "notes.txt").write_text("not a photo")
    kept = keep(folder, tmp_path)
    assert [f.source for f in kept.frames] == [f"img{i + 1}{suffix}" for i in range(11)]
    assert not kept.is_video


def test_photos_beyond_the_most_are_counted(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "photos", pan([20.0 * i for i in range(9)]))
    kept = keep(folder, tmp_path, max_frames=6)
    (note,) = kept.warnings
    assert "6 of 9 photos are used, spread evenly; --max-frames 9 uses all" in note


def test_large_frames_are_reduced_to_the_working_size(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "photos", [wallpaper(size=900)[:600], wallpaper(1)[:600]])
    recording = open_recording(folder, max_side=300)
    kept = select_frames(recording, tmp_path / "frames")
    image = cv2.imread(str(tmp_path / "frames" / kept.names[0]), cv2.IMREAD_UNCHANGED)
    assert image.shape == (200, 300)
    assert (kept.width, kept.height) == (300, 200)


def refused(path: Path, tmp_path: Path) -> str:
    with pytest.raises(BadInputError) as caught:
        keep(path, tmp_path)
    assert "\n" not in str(caught.value)
    assert str(path.name) in str(caught.value)
    return str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "gone.mp4", tmp_path)


def test_text_named_mp4(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "v.mp4").write_text("this is not a video\n" * 100)
    assert "not a readable video" in refused(tmp_path / "v.mp4", tmp_path)
    assert capfd.readouterr() == ("", "")


def test_empty_file(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").touch()
    assert "not a readable video" in refused(tmp_path / "v.mp4", tmp_path)


def test_one_frame(tmp_path: Path) -> None:
    assert "at least 2" in refused(write_video(tmp_path / "v.mkv", pan([0.0])), tmp_path)


def test_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    assert "no photos" in refused(tmp_path / "photos", tmp_path)


def test_broken_photo(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "photos", pan([0.0, 20.0]))
    (folder / "img3.png").write_bytes(b"nothing of the kind")
    with pytest.raises(BadInputError, match=r"img3\.png: not a readable image"):
        keep(folder, tmp_path)


def test_a_thumbnail_among_photos_is_left_out_and_counted(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "photos", [*pan([0.0, 20.0]), wallpaper()[:100, :100]])
    kept = keep(folder, tmp_path)
    assert [frame.source for frame in kept.frames] == ["img1.png", "img2.png"]
    assert "thumbnail: 1 (img3.png)" in kept.warnings[0]


def test_truncated_video_gives_what_decodes(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = write_video(tmp_path / "whole.mkv", pan([5.0 * i for i in range(60)])).read_bytes()
    (tmp_path / "cut.mkv").write_bytes(whole[: len(whole) // 2])
    kept = keep(tmp_path / "cut.mkv", tmp_path)
    assert 25 <= len(kept) <= 31
    assert "truncated" in kept.warnings[0]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "error", [av.error.ExternalError, av.error.EOFError, av.error.UnknownError, OSError]
)
def test_every_error_of_the_decoder_is_caught(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    (tmp_path / "v.mp4").write_bytes(b"video")

    def fail(*_: object, **__: object) -> None:
        raise error(1, "it broke")

    monkeypatch.setattr(av, "open", fail)
    assert "it broke" in refused(tmp_path / "v.mp4", tmp_path)


@pytest.mark.parametrize("kind", ["video", "photos", "unknown"])
def test_one_bar_rises_over_watching_and_writing(tmp_path: Path, kind: str) -> None:
    frames = pan([5.0 * i for i in range(10)])
    photos = kind == "photos"
    path = tmp_path / ("photos" if photos else "v.mkv")
    recording = open_recording((write_photos if photos else write_video)(path, frames))
    if kind == "unknown":
        recording = replace(recording, expected_frames=0)
    told: list[float] = []
    select_frames(recording, tmp_path / "frames", progress=lambda _, share: told.append(share))
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert told[9] == (-1.0 if kind == "unknown" else pytest.approx(0.5))


def test_whole_video_has_no_warning(tmp_path: Path) -> None:
    kept = keep(write_video(tmp_path / "v.mkv", pan([5.0 * i for i in range(30)])), tmp_path)
    assert kept.warnings == ()


def exif(tags: dict[int, tuple[str, float | str]]) -> bytes:
    """An APP1 segment with one directory; 'H' stands in the entry, 'R' and 'A' (text) behind."""
    entries, tail = b"", b""
    start = 8 + 2 + 12 * len(tags) + 4
    for tag, (kind, value) in sorted(tags.items()):
        if kind == "R":
            entries += struct.pack("<HHII", tag, 5, 1, start + len(tail))
            tail += struct.pack("<II", round(value * 1000), 1000)
        elif kind == "A":
            entries += struct.pack("<HHII", tag, 2, len(value) + 1, start + len(tail))
            tail += value.encode() + b"\0"
        else:
            entries += struct.pack("<HHI", tag, 3, 1) + struct.pack("<HH", int(value), 0)
    body = b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries
    payload = b"Exif\0\0" + body + struct.pack("<I", 0) + tail
    return b"\xff\xe1" + struct.pack(">H", len(payload) + 2) + payload


def photo_with(path: Path, tags: dict[int, tuple[str, float]]) -> Path:
    _, jpeg = cv2.imencode(".jpg", wallpaper()[:100, :200])
    content = jpeg.tobytes()
    path.write_bytes(content[:2] + exif(tags) + content[2:])
    return path


def test_focal_from_35_mm_equivalent(tmp_path: Path) -> None:
    prior = focal_of_photo(photo_with(tmp_path / "a.jpg", {0xA405: ("H", 27)}))
    assert prior is not None
    assert prior.relative == pytest.approx(27 / 36)


def test_focal_of_a_resized_photo_uses_the_original_size(tmp_path: Path) -> None:
    tags = {
        0x920A: ("R", 4.5),
        0xA002: ("H", 4000),
        0xA003: ("H", 3000),
        0xA20E: ("R", 16393.443),
        0xA210: ("H", 2),
    }
    prior = focal_of_photo(photo_with(tmp_path / "a.jpg", tags))
    assert prior is not None
    assert prior.relative == pytest.approx(4.5 / (4000 / 16393.443 * 25.4), rel=1e-4)


def test_photo_without_metadata_has_no_focal(tmp_path: Path) -> None:
    assert focal_of_photo(photo_with(tmp_path / "a.jpg", {})) is None


def test_focal_from_video_metadata() -> None:
    key = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
    prior = focal_of_video({key: "26", "encoder": "x"})
    assert prior is not None
    assert prior.relative == pytest.approx(26 / 36)
    assert focal_of_video({"encoder": "x"}) is None


def test_focal_priors_of_real_cameras(shared_data: Path) -> None:
    sfm = shared_data / "2_sfm"
    caliterra = focal_of_photo(sfm / "drone_caliterra_gps/images_half/IMG_9354.jpg")
    brighton = focal_of_photo(sfm / "drone_brighton_beach_gps/images_half/DJI_0018.JPG")
    assert caliterra is not None
    assert brighton is not None
    assert caliterra.relative == pytest.approx(0.726, abs=0.01)
    assert brighton.relative == pytest.approx(20 / 36, abs=0.01)


WIDE: dict[int, tuple[str, float | str]] = {0x920A: ("R", 5.0), 0xA405: ("H", 32)}
LENS_A, LENS_B = "10-24mm F4", "16mm F2.8"
OTHERS: dict[str, dict[int, tuple[str, float | str]]] = {
    "zoom": {0x920A: ("R", 7.5), 0xA405: ("H", 47)},
    "digital zoom": WIDE | {0xA404: ("R", 1.5)},
    "no focal length": {},
    "camera": WIDE | {0x0110: ("A", "Another")},
    "lens": WIDE | {0xA434: ("A", LENS_B)},
}


def write_tagged(
    folder: Path,
    groups: list[tuple[int, dict[int, tuple[str, float | str]]]],
    shape: tuple[int, int] = (HEIGHT, WIDTH),
) -> Path:
    """JPEG photos, so many of each group one after the other."""
    folder.mkdir(exist_ok=True)
    tags = [tags for count, tags in groups for _ in range(count)]
    start = len(list(folder.iterdir()))
    images = pan([6.0 * i for i in range(len(tags))])
    for i, (each, image) in enumerate(zip(tags, images, strict=True), start=start):
        jpeg = cv2.imencode(".jpg", image[: shape[0], : shape[1]])[1].tobytes()
        (folder / f"img{i:02d}.jpg").write_bytes(jpeg[:2] + exif(each) + jpeg[2:])
    return folder


@pytest.mark.parametrize("other", OTHERS)
def test_a_run_takes_the_largest_group_of_photos(tmp_path: Path, other: str) -> None:
    common = WIDE | {0xA434: ("A", LENS_A)} if other == "lens" else WIDE
    folder = write_tagged(tmp_path / "photos", [(4, OTHERS[other]), (6, common)])
    recording = open_recording(folder, one_camera=True)
    kept = select_frames(recording, tmp_path / "frames")
    assert kept.indices.tolist() == [4, 5, 6, 7, 8, 9]
    assert kept.frames[0].source == "img04.jpg"
    assert kept.focal_prior_px == pytest.approx(32 / 36 * WIDTH)
    (note,) = kept.warnings
    assert "of 2 cameras, lenses, zooms or sizes" in note
    assert "4 of 10 photos are left out" in note


def test_photos_without_a_focal_length_are_of_no_group_where_others_state_several(
    tmp_path: Path,
) -> None:
    folder = write_tagged(tmp_path / "photos", [(6, {}), (4, WIDE), (3, OTHERS["zoom"])])
    recording = open_recording(folder, one_camera=True)
    assert [photo.name for photo in recording.photos] == [f"img{i:02d}.jpg" for i in range(6, 10)]
    assert "the first group is used and 9 of 13 photos are left out" in recording.warnings[0]
    folder = write_tagged(tmp_path / "more", [(6, {}), (4, WIDE)])
    assert len(open_recording(folder, one_camera=True).photos) == 6


def test_photos_of_a_second_size_are_left_out_and_counted(tmp_path: Path) -> None:
    folder = write_tagged(tmp_path / "photos", [(2, WIDE)], shape=(180, WIDTH))
    write_tagged(folder, [(5, WIDE)])
    recording = open_recording(folder, one_camera=True)
    kept = select_frames(recording, tmp_path / "frames")
    assert (kept.width, kept.height) == (WIDTH, HEIGHT)
    assert len(kept) == 5
    assert "2 of 320x180" in kept.warnings[0]


def test_photos_of_one_zoom_are_all_used(tmp_path: Path) -> None:
    nearly = {0x920A: ("R", 5.03), 0xA405: ("H", 32)}
    folder = write_tagged(tmp_path / "photos", [(3, WIDE), (3, nearly)])
    recording = open_recording(folder, one_camera=True)
    kept = select_frames(recording, tmp_path / "frames")
    assert len(kept) == 6
    assert kept.warnings == ()


def test_turned_photos_have_the_size_they_are_shown_with(tmp_path: Path) -> None:
    folder = write_tagged(tmp_path / "photos", [(3, WIDE | {0x0112: ("H", 6)})])
    recording = open_recording(folder, one_camera=True)
    assert recording.sizes.source == (HEIGHT, WIDTH)
    assert optics_of_photo(recording.photos[0]).size == (HEIGHT, WIDTH)


@pytest.mark.parametrize("portrait", [6, 8])
@pytest.mark.parametrize("portrait_first", [True, False])
def test_portrait_and_landscape_are_of_one_camera(
    tmp_path: Path, portrait: int, portrait_first: bool
) -> None:
    """Each is used as the sensor saw it."""
    groups = [(4, WIDE | {0x0112: ("H", 1)}), (2, WIDE | {0x0112: ("H", portrait)})]
    folder = write_tagged(tmp_path / "photos", groups[:: -1 if portrait_first else 1])
    recording = open_recording(folder, one_camera=True)
    frames = list(recording.frames())
    assert [frame.image.shape for frame in frames] == [(HEIGHT, WIDTH)] * 6
    seen = pan([6.0 * i for i in range(6)])
    for frame, image in zip(frames, seen, strict=True):
        assert np.abs(frame.image.astype(float) - image).mean() < 4
    (note,) = recording.warnings
    assert note.startswith("2 of 6 photos are turned by 90 degrees")


def test_photos_that_state_no_turn_are_turned_to_the_size_of_most(tmp_path: Path) -> None:
    folder = write_tagged(tmp_path / "photos", [(3, WIDE)])
    write_tagged(folder, [(2, WIDE)], shape=(HEIGHT, HEIGHT))
    for name in ("img03.jpg", "img04.jpg"):
        tall = np.ascontiguousarray(pan([0.0])[0].T)
        jpeg = cv2.imencode(".jpg", tall)[1].tobytes()
        (folder / name).write_bytes(jpeg[:2] + exif(WIDE) + jpeg[2:])
    frames = list(open_recording(folder, one_camera=True).frames())
    assert [frame.image.shape for frame in frames] == [(HEIGHT, WIDTH)] * 5


def test_a_broken_photo_among_groups_is_named(tmp_path: Path) -> None:
    folder = write_tagged(tmp_path / "photos", [(2, OTHERS["zoom"]), (3, WIDE)])
    (folder / "img99.jpg").write_bytes(b"nothing of the kind")
    with pytest.raises(BadInputError, match=r"img99\.jpg: not a readable image"):
        select_frames(open_recording(folder, one_camera=True), tmp_path / "frames")
