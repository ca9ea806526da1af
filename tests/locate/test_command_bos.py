from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from detect.synthesis import shards_in
from geometry.errors import BadInputError
from locate.commands.bos import bos, parse_reference

STILL, PLUMES = 5, 3


def frames(gain: float = 1.0) -> list[np.ndarray]:
    """Smooth noise before a camera that stands; a lens of air in the last frames."""
    rng = np.random.default_rng(0)
    wide = cv2.GaussianBlur(rng.normal(0, 1, (128, 192)), (0, 0), 1.5)
    wall = 128 + 40 * wide / wide.std()
    y, x = np.mgrid[:96, :160].astype(np.float32)
    bump = np.exp(-((x - 80) ** 2 + (y - 48) ** 2) / 300).astype(np.float32)
    images = []
    for k in range(STILL + PLUMES):
        strength = 0.05 * (k >= STILL)
        seen = cv2.remap(
            wall.astype(np.float32),
            x + 16 + strength * (x - 80) * bump,
            y + 16 + strength * (y - 48) * bump,
            cv2.INTER_LINEAR,
        )
        seen = seen * (gain if k >= STILL else 1) + rng.normal(0, 0.7, seen.shape)
        images.append(seen.clip(0, 255).round().astype(np.uint8))
    return images


def photos(folder: Path, gain: float = 1.0) -> Path:
    folder.mkdir()
    for k, image in enumerate(frames(gain)):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return folder


def video(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 96, "gray"
        for image in frames():
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode())
    return path


def run(*arguments: object) -> str:
    app = typer.Typer()
    app.command()(bos)
    result = CliRunner().invoke(app, [str(word) for word in arguments], catch_exceptions=True)
    if isinstance(result.exception, BadInputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_video_and_a_folder_become_one_dataset(tmp_path: Path) -> None:
    film, folder, data = video(tmp_path / "film.mkv"), photos(tmp_path / "wall"), tmp_path / "data"
    said = run(film, folder, "-o", data, "--reference", f"first:{STILL}", "--size", 64,
               "--flow", "lucas-kanade", "--split", "validation")  # fmt: skip
    assert "film: 3 of 3 frames, 18 crops for validation" in said
    assert sum(map(len, shards_in(data / "validation"))) == 2 * 3 * 6
    one, other = shards_in(data / "validation")
    assert np.array_equal(one.images, other.images)


def test_the_reference_may_be_a_file_at_the_frames_own_size(tmp_path: Path) -> None:
    folder, data = photos(tmp_path / "wall"), tmp_path / "data"
    run(folder, "-o", data, "--reference", folder / "0.png", "--size", 96, "--every", 4,
        "--flow", "lucas-kanade", "--split", "test")  # fmt: skip
    (shard,) = shards_in(data / "test")
    assert np.array_equal(shard.images[0], frames()[0][:, :96])


def test_what_is_refused_is_told_and_the_rest_is_kept(tmp_path: Path) -> None:
    bad, good = photos(tmp_path / "bad", gain=0.95), photos(tmp_path / "good")
    with pytest.raises(BadInputError, match="1 of 2 recordings refused"):
        run(bad, good, "-o", tmp_path / "data", "--reference", f"first:{STILL}", "--size", 96,
            "--flow", "lucas-kanade", "--split", "train")  # fmt: skip
    shards = [path.name for path in (tmp_path / "data/train").glob("shard_*")]
    assert shards == ["shard_good_00000.npz"]
    assert (tmp_path / "data/recordings/bad.json").exists()


def test_a_reference_is_a_count_or_a_file(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "wall.png"), frames()[0])
    assert parse_reference("first:50") == 50
    assert np.array_equal(parse_reference(str(tmp_path / "wall.png")), frames()[0])


@pytest.mark.parametrize(
    "text", ["first:0", "first:", "first:-3", "first:ten", "first:" + "9" * 5000, "nowhere.png"]
)
def test_a_reference_that_is_neither_is_named(text: str) -> None:
    with pytest.raises(BadInputError, match=text[:20]):
        parse_reference(text)


def test_a_missing_recording_is_named_before_another_is_measured(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="nowhere"):
        run(photos(tmp_path / "wall"), tmp_path / "nowhere", "-o", tmp_path / "data",
            "--reference", f"first:{STILL}", "--size", 96)  # fmt: skip
    assert not (tmp_path / "data").exists()


def test_an_unknown_flow_is_named_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="flow method 'spynet' is unknown"):
        run(photos(tmp_path / "wall"), "-o", tmp_path / "data", "--flow", "spynet",
            "--reference", f"first:{STILL}", "--size", 96)  # fmt: skip
    assert not (tmp_path / "data").exists()
