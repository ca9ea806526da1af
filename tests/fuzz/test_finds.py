"""What fuzzing found, each as a small test of its kind."""

import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import av
import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from pydantic import ValidationError

from detect.calibration import Calibration
from detect.detection import Detection
from detect.response import Response
from geometry.errors import BadInputError
from geometry.image_files import read_image
from geometry.json_text import parse_json
from geometry.npz import read_npz, save_arrays
from geometry.pose_files import read_poses, write_colmap_model, write_transforms_json
from geometry.printable import printable, printable_lines
from geometry.removal import is_plain_name
from locate.commands.console import PlainConsole
from locate.export.kml import write_kml
from locate.pipeline.config import RunConfig
from locate.pipeline.detections import load_response
from locate.pipeline.placement import Placement
from locate.pipeline.points import load_points
from locate.recording.decoders import photo_size
from locate.recording.images import read_grey
from locate.recording.index import KeyFrames
from locate.recording.opening import open_recording
from locate.recording.writer import create_video
from locate.simulation.campaign import ThermalSite
from locate.simulation.photo_set import PhotoSet
from locate.survey.flights import read_config
from locate.telemetry import read_telemetry
from tests.fuzz.bounds import impatient, read_bounded
from tests.fuzz.readers import READERS, texture
from tests.locate.answers import orbit
from tests.locate.survey_runs import FIELD, Flown, answer

NASTY_NAME = "a\x1b[2J\x07\n[bold]b[/bold] :smile: \u2028\x9b"


def test_names_are_printed_on_one_line_without_control() -> None:
    shown = printable(NASTY_NAME)
    assert shown == r"a\x1b[2J\x07\x0a[bold]b[/bold] :smile: \u2028\x9b"
    assert printable_lines("a\n\tb\r") == "a\n\tb\\x0d"


def test_every_refusal_is_one_line_without_control() -> None:
    said = str(BadInputError(f"{NASTY_NAME}: not readable (line 1\n  line 2\n\n)"))
    assert len(said.splitlines()) == 1
    assert said.isprintable()
    assert "(line 1 line 2 )" in said


def test_a_refusal_that_quotes_a_file_is_short() -> None:
    said = str(BadInputError(f"a.json: {'x' * 1_000_000}: expected a number"))
    assert len(said) < 1000
    assert said.startswith("a.json: x")
    assert said.endswith("x: expected a number")


@pytest.mark.parametrize("number", [2**63, -(2**63), 10**400])
def test_whole_numbers_that_no_array_holds_are_refused(number: int) -> None:
    assert parse_json(json.dumps([2**63 - 1, 1 - 2**63])) == [2**63 - 1, 1 - 2**63]
    with pytest.raises(ValueError, match="digits"):
        parse_json(json.dumps({"a": number}))


def test_the_console_prints_names_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    PlainConsole(width=200).print(f"Report: /{NASTY_NAME}/[/]", soft_wrap=True)
    said = capsys.readouterr().out
    assert "[bold]b[/bold] :smile:" in said
    assert said.endswith("/[/]\n")
    assert "\x1b" not in said
    assert "\x07" not in said


def test_kml_holds_notes_with_control_characters(tmp_path: Path) -> None:
    found = answer(Flown(name="a", feet=np.zeros((1, 3))), FIELD)
    write_kml(tmp_path / "a.kml", replace(found, notes=(f"{NASTY_NAME}: damaged",)))
    text = "".join(ElementTree.parse(tmp_path / "a.kml").getroot().itertext())
    assert r"a\x1b[2J" in text


@pytest.mark.parametrize("dtype", ["c8", "M8[s]", "V4", "S3"])
def test_arrays_that_are_no_real_numbers_are_refused(tmp_path: Path, dtype: str) -> None:
    save_arrays(tmp_path / "a.npz", a=np.zeros(2, dtype))
    with pytest.raises(BadInputError, match="are not read"):
        read_npz(tmp_path / "a.npz")
    with pytest.raises(BadInputError, match="are not read"):
        Detection.load(tmp_path / "a.npz")


@pytest.mark.parametrize("number", ["1" + "0" * 400, "null", '"a"', "[]", "NaN"])
def test_a_damaged_response_of_detections_is_refused(tmp_path: Path, number: str) -> None:
    response = f'{{"ratios": [0.0, 1.0], "llr": [-1.0, {number}]}}'
    text = f'{{"detector": "registered", "indices": [], "response": {response}}}'
    (tmp_path / "index.json").write_text(text)
    with pytest.raises(BadInputError, match=r"index\.json"):
        load_response(tmp_path)


@pytest.mark.parametrize(
    "points", [np.zeros((2, 2)), np.zeros(3), np.full((1, 3), np.nan), np.array([["a"] * 3])]
)
def test_points_of_another_shape_are_refused(tmp_path: Path, points: np.ndarray) -> None:
    save_arrays(tmp_path / "points.npz", points_in_world=points)
    with pytest.raises(BadInputError, match="points"):
        load_points(tmp_path / "points.npz")
    save_arrays(tmp_path / "points.npz", other=points)
    with pytest.raises(BadInputError, match="points"):
        load_points(tmp_path / "points.npz")


@pytest.mark.parametrize("text", ["[]", "{}", "{", '{"alignment": 3}', '{"alignment": null}'])
def test_a_damaged_placement_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "placement.json").write_text(text)
    with pytest.raises(BadInputError, match=r"placement\.json"):
        Placement.load(tmp_path / "placement.json")


@pytest.mark.parametrize("text", ["recording: a\nmax_frames: x\n", "a: [", "- a"])
def test_a_damaged_run_configuration_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(BadInputError, match=r"config\.yaml") as refused:
        read_config(tmp_path)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b"])
def test_names_that_no_file_system_takes_are_of_no_file(tmp_path: Path, name: str) -> None:
    settings = {"recording": name, "max_frames": 5}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(settings))
    if "\0" in name:
        with pytest.raises(BadInputError, match="recording: holds a zero byte"):
            read_config(tmp_path)
    else:
        assert read_config(tmp_path) is None
    write_transforms_json(orbit(2), tmp_path / "transforms.json", [name, name])
    with pytest.raises(BadInputError, match="name no photo"):
        PhotoSet.load(tmp_path)
    assert not is_plain_name(name)


@pytest.mark.parametrize(
    "changed",
    [{"width": None}, {"height": 0}, {"frames": [{"index": 0.5}]}, {"focal_prior_px": "nan"}, {}],
)
def test_a_damaged_index_of_frames_is_refused(tmp_path: Path, changed: dict[str, object]) -> None:
    frame = {"index": 0, "time_s": 0.0, "source": "a", "sharpness": 1.0, "motion_px": 0.0}
    good = {"frames": [frame], "width": 4, "height": 4, "is_video": True, "static": False}
    content = {"schema": "locate.frames/1", **good} | changed if changed else []
    (tmp_path / "index.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"index\.json"):
        KeyFrames.load(tmp_path / "index.json")


def test_rotations_whose_squares_overflow_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    write_transforms_json(orbit(3), path)
    content = json.loads(path.read_text())
    content["frames"][0]["transform_matrix"][0][0] = 1e200
    path.write_text(json.dumps(content))
    with pytest.raises(BadInputError, match="skewed or scaled"):
        read_poses(path)


@pytest.mark.parametrize("damage", ["name", "missing"])
def test_a_colmap_model_that_breaks_after_it_was_read_is_refused(
    tmp_path: Path, damage: str
) -> None:
    write_colmap_model(orbit(3), np.eye(3), tmp_path)
    path = tmp_path / "images.bin"
    if damage == "name":
        path.write_bytes(path.read_bytes().replace(b"000002.png", b"\xff\xfe0002.png"))
    else:
        pycolmap.Reconstruction(tmp_path).write_text(tmp_path)
        for binary in tmp_path.glob("*.bin"):
            binary.unlink()
        images = tmp_path / "images.txt"
        kept = [line for line in images.read_text().splitlines() if "000002.png" not in line]
        images.write_text("\n".join(kept) + "\n")
    with pytest.raises(BadInputError, match="not a whole COLMAP model"):
        read_poses(tmp_path)


def png(side: int, bits: int = 8, colour: int = 0) -> bytes:
    """A black square, by its header; it holds fewer rows."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        checked = kind + body
        return struct.pack(">I", len(body)) + checked + struct.pack(">I", zlib.crc32(checked))

    head = struct.pack(">IIBBBBB", side, side, bits, colour, 0, 0, 0)
    rows = zlib.compress(bytes(100 * (side + 1)))
    start = b"\x89PNG\r\n\x1a\n"
    return start + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_an_image_of_more_pixels_than_cameras_have_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(30_000))
    command = [sys.executable, "-m", "locate", "detect", str(tmp_path / "a.png"), "-o", "out"]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert said.returncode == 2
    assert "over 200 megapixels" in " ".join(said.stderr.split())
    read_bounded(open_recording, tmp_path / "a.png")


@pytest.mark.parametrize("suffix", [".png", ".jp2"])
def test_an_image_of_too_many_deep_channels_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    if suffix == ".png":
        path.write_bytes(png(14_000, bits=16, colour=6))
    else:
        content = bytearray(cv2.imencode(".jp2", np.zeros((48, 64, 4), np.uint16))[1].tobytes())
        size = content.index(b"\xff\x4f\xff\x51") + 8
        struct.pack_into(">II", content, size, 14_000, 14_000)
        path.write_bytes(content)
    with pytest.raises(BadInputError, match="over 1 GiB while it is decoded"):
        read_grey(path)
    assert photo_size(path) is None
    with pytest.raises(BadInputError, match="not a readable image"):
        read_image(path)


def test_a_video_of_more_pixels_than_cameras_have_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=5)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "gray"
        frame = av.VideoFrame.from_ndarray(np.zeros((64, 64), np.uint8), format="gray")
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    assert next(iter(open_recording(path).frames())).image.shape == (64, 64)
    monkeypatch.setattr("locate.recording.container.MOST_PIXELS", 64 * 63)
    with pytest.raises(BadInputError, match="megapixels"):
        open_recording(path)


def test_a_video_of_a_codec_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    READERS["a.mkv"].write(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"V_MPEG4", b"V_NO_SU"))
    with pytest.raises(BadInputError, match="no codec that can be decoded"):
        open_recording(path)


@pytest.mark.parametrize("number", [1e155, 1e200, 1e300])
def test_quaternions_whose_squares_overflow_are_refused(tmp_path: Path, number: float) -> None:
    content = orbit(3).to_dict()
    content["frames"][0]["cam_from_world"]["rotation_xyzw"][0] = number
    (tmp_path / "trajectory.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match="rotation_xyzw: a quaternion is zero or far too long"):
        read_poses(tmp_path / "trajectory.json")


def test_a_displacement_too_large_for_single_precision_is_refused(tmp_path: Path) -> None:
    READERS["truth of a frame"].write(tmp_path)
    path = tmp_path / "truth" / "000000.npz"
    save_arrays(path, displacement=np.full((6, 8, 2), 1e50), mask=np.ones((6, 8), bool))
    with pytest.raises(BadInputError, match="too large"):
        READERS["truth of a frame"].read(path)


@pytest.mark.parametrize("wind", [float("inf"), 1e308])
def test_a_campaign_with_a_wind_that_is_none_is_refused(tmp_path: Path, wind: float) -> None:
    reader = READERS["truth of a campaign"]
    reader.write(tmp_path)
    content = json.loads((tmp_path / reader.file).read_text())
    content["flights"][0]["wind_mps"][0] = wind
    (tmp_path / reader.file).write_text(json.dumps(content))
    with pytest.raises(BadInputError, match="not a wind"):
        reader.read(tmp_path / reader.file)


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("points of a reconstruction", {"visible": np.int64(0)}),
        ("points of a reconstruction", {"visible": np.full(12, 5)}),
        ("points of a reconstruction", {"point_errors_px": np.array(["a"] * 5)}),
        ("shard", {"displacements": np.full((2, 8, 8, 2), "a")}),
        ("shard", {"displacements": np.full((2, 8, 8, 2), 1e300)}),
        ("shard", {"displacements": np.ones((2, 8, 8, 2), bool)}),
        ("truth of a frame", {"displacement": np.full((6, 8, 2), "1")}),
        ("truth of a frame", {"displacement": np.ones((6, 8, 2), bool)}),
        ("detection", {"llr": np.full((12, 16), "1")}),
        ("detection", {"llr": np.ones((12, 16), bool)}),
        ("points", {"points_in_world": np.full((3, 3), "1")}),
        ("points", {"points_in_world": np.ones((3, 3), bool)}),
        ("coverage", {"limit_px": np.ones((3, 4), bool)}),
        ("training clip", {"amplitude_px": np.array("1")}),
        ("training clip", {"displacements": np.full((2, 8, 8, 2), "a")}),
    ],
)
def test_arrays_of_another_kind_are_refused(
    tmp_path: Path, name: str, changed: dict[str, np.ndarray]
) -> None:
    reader = READERS[name]
    reader.write(tmp_path)
    reader.read(tmp_path / reader.file)
    save_arrays(tmp_path / reader.file, **read_npz(tmp_path / reader.file) | changed)
    with pytest.raises(BadInputError):
        reader.read(tmp_path / reader.file)


@pytest.mark.parametrize("other", [True, "1"])
def test_calibrations_of_truth_values_and_texts_are_refused(other: object) -> None:
    response = {"ratios": [0.0, 1.0], "llr": [0.0, 1.0]}
    scale = {"weights": [1.0, 0.5], "offset": -2.0, "prior": 0.1, "auroc": 0.9}
    for name in response:
        with pytest.raises(BadInputError, match=f"{name}: .* is no number"):
            Response.from_plain(response | {name: [0.0, other]}, "a")
    for changed in ({"weights": [1.0, other]}, {"prior": other}):
        content = {"scores": ["logit", "excess"], "classes": {"smooth": scale | changed}}
        with pytest.raises(BadInputError, match="not a calibration"):
            Calibration.from_plain(content, "a")


def test_names_in_settings_are_no_truth_values() -> None:
    site = {"name": "a", "position": [0.0, 0.0, 0.0], "occurrence": {True: 0.5}}
    with pytest.raises(ValidationError, match="no number"):
        ThermalSite.model_validate(site)


def test_half_an_index_is_refused(tmp_path: Path) -> None:
    content = orbit(3).to_dict()
    content["frames"][0]["index"] = 0.5
    (tmp_path / "trajectory.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"index: 0\.5 is no whole number"):
        read_poses(tmp_path / "trajectory.json")


def test_a_plume_axis_whose_square_overflows_is_refused(tmp_path: Path) -> None:
    reader = READERS["truth"]
    reader.write(tmp_path)
    content = json.loads((tmp_path / reader.file).read_text())
    content["plumes"][0]["axis"][0] = 1e300
    (tmp_path / reader.file).write_text(json.dumps(content))
    with pytest.raises(BadInputError, match="axis"):
        reader.read(tmp_path / reader.file)


@pytest.mark.parametrize("number", [1e308, float("inf"), float("nan"), 0])
def test_settings_that_no_camera_has_are_refused(number: float) -> None:
    for name in ("focal_px", "camera_height_m"):
        with pytest.raises(ValidationError):
            RunConfig.model_validate({"recording": "a.mp4", name: number})


LISTS = {
    "ffconcat": "ffconcat version 1.0\nfile secret.mp4\n",
    "HLS": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nsecret.mp4\n#EXT-X-ENDLIST\n",
    "SDP": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=a\nc=IN IP4 127.0.0.1\nt=0 0\n"
    "m=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
}


@pytest.mark.parametrize("name", LISTS)
@pytest.mark.parametrize("suffix", [".mp4", ".m3u8", ".ffconcat", ".sdp"])
@pytest.mark.parametrize("read", [open_recording, read_telemetry])
def test_a_video_names_no_other_files(
    tmp_path: Path, read: Callable[[Path], object], suffix: str, name: str
) -> None:
    os.mkfifo(tmp_path / "secret.mp4")
    listing = tmp_path / f"a{suffix}"
    listing.write_text(LISTS[name])
    with impatient(), pytest.raises(BadInputError, match=f"a{suffix}: "):
        read(listing)


@pytest.mark.parametrize("name", ["v.avi", "v.mkv", "v.mov", "v.mpg", "v.ts", "v.webm", "v.wmv"])
def test_usual_videos_are_read(tmp_path: Path, name: str) -> None:
    codecs = {".webm": "libvpx-vp9", ".wmv": "wmv2", ".mpg": "mpeg2video"}
    codec = codecs.get(Path(name).suffix, "libx264")
    with create_video(tmp_path / name, size=(64, 48), fps=25, codec=codec) as video:
        for seed in range(3):
            video.write(texture(seed))
    assert open_recording(tmp_path / name).width == 64


def test_a_large_stack_takes_little_memory_and_a_larger_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    cv2.imwritemulti(str(path), [texture(seed) for seed in range(3)])
    os.truncate(path, 2**31 - 1)
    read: list[int] = []
    read_bounded(lambda path: read.extend(f.index for f in open_recording(path).frames()), path)
    assert read == [0, 1, 2]
    os.truncate(path, 2**31)
    with pytest.raises(BadInputError, match="a TIFF over 2 GiB is not read"):
        open_recording(path)
