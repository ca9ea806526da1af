import re
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from geometry.errors import BadInputError
from locate.commands.pattern import find_period_mm, pattern
from locate.printing.sheet import paper_mm

KINDS = ("checkerboard", "sinusoid", "perlin", "squares")
DPI, PERIOD_MM = 150, 6.3
SMALL = ("--paper", "90x60mm", "--dpi", DPI, "--period-mm", PERIOD_MM)


def run(*arguments: object) -> str:
    app = typer.Typer()
    app.command()(pattern)
    result = CliRunner().invoke(app, [str(word) for word in arguments])
    if isinstance(result.exception, BadInputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stdout


def chunks(png: bytes) -> dict[bytes, bytes]:
    found, at = {}, 8
    while at < len(png):
        (length,) = struct.unpack_from(">I", png, at)
        name, data = png[at + 4 : at + 8], png[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", png, at + 8 + length)[0] == zlib.crc32(name + data)
        found[name] = data
        at += 12 + length
    return found


def image_of(pdf: bytes) -> np.ndarray:
    header = re.search(rb"/Width (\d+)/Height (\d+).*?/Length (\d+)>>\nstream\n", pdf, re.DOTALL)
    assert header is not None
    width, height, length = map(int, header.groups())
    data = zlib.decompress(pdf[header.end() : header.end() + length])
    return np.frombuffer(data, np.uint8).reshape(height, width)


def measured_period_mm(row: np.ndarray) -> float:
    """The strongest of many trial periods."""
    places = np.arange(len(row)) * 25.4 / DPI
    trials = np.linspace(0.8 * PERIOD_MM, 1.2 * PERIOD_MM, 4001)
    weighted = (row - row.mean()) * np.hanning(len(row))
    power = np.abs(np.exp(2j * np.pi * places / trials[:, None]) @ weighted)
    return float(trials[power.argmax()])


@pytest.mark.parametrize("kind", KINDS)
def test_a_png_has_the_page_its_resolution_and_white_edges(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "wall.png"
    run(kind, "-o", path, *SMALL)
    per_metre, also, unit = struct.unpack(">IIB", chunks(path.read_bytes())[b"pHYs"])
    assert (per_metre, also, unit) == (round(DPI / 0.0254), round(DPI / 0.0254), 1)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image.shape == (355, 532)  # 60 and 90 mm in dots, rounded up
    edge = round(10 / 25.4 * DPI)
    assert (image[: edge - 1] == 255).all()
    assert (image[:, -edge + 1 :] == 255).all()
    inside = image[edge + 1 : -edge - 2, edge + 1 : -edge - 2].astype(float)
    assert 90 < inside.mean() < 165
    assert inside.std() > 35


def test_the_period_on_paper_is_the_one_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "wall.png"
    run("sinusoid", "-o", path, *SMALL, "--margin-mm", 0)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)
    assert measured_period_mm(image.mean(axis=0)) == pytest.approx(PERIOD_MM, rel=1e-3)
    assert measured_period_mm(image.mean(axis=1)) == pytest.approx(PERIOD_MM, rel=1e-3)


def test_a_period_of_the_checkerboard_spans_two_squares(tmp_path: Path) -> None:
    path = tmp_path / "wall.png"
    run("checkerboard", "-o", path, *SMALL, "--margin-mm", 0)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)
    assert set(np.unique(image)) == {0, 255}
    assert measured_period_mm(image[5]) == pytest.approx(PERIOD_MM, rel=2e-3)


def test_a_pdf_is_as_large_as_the_paper_and_its_dots_as_they_should_be(tmp_path: Path) -> None:
    path = tmp_path / "wall.pdf"
    run("squares", "-o", path, *SMALL)
    pdf = path.read_bytes()
    box = re.search(rb"/MediaBox\[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    assert box is not None
    assert [float(side) / 72 * 25.4 for side in box.groups()] == pytest.approx([90, 60])
    image = image_of(pdf)
    placed = re.search(rb"q ([\d.]+) 0 0 ([\d.]+) 0 (-?[\d.]+) cm", pdf)
    assert placed is not None
    width, height, bottom = map(float, placed.groups())
    assert width / 72 * DPI == pytest.approx(image.shape[1])
    assert height / 72 * DPI == pytest.approx(image.shape[0])
    assert bottom + height == pytest.approx(60 / 25.4 * 72)
    run("squares", "-o", tmp_path / "wall.png", *SMALL)
    drawn = cv2.imread(str(tmp_path / "wall.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(image, drawn)


def test_a_pdf_finds_its_own_objects(tmp_path: Path) -> None:
    path = tmp_path / "wall.pdf"
    run("checkerboard", "-o", path, *SMALL)
    pdf = path.read_bytes()
    start = int(pdf.rstrip().splitlines()[-2])
    lines = pdf[start:].split(b"\n")
    assert lines[0] == b"xref"
    for number, line in enumerate(lines[3:9], start=1):
        assert len(line) == 19  # and the line feed: 20 bytes, as the format has it
        assert pdf[int(line[:10]) :].startswith(f"{number} 0 obj".encode())
    for part in re.finditer(rb"/Length (\d+)>>\nstream\n", pdf):
        assert pdf[part.end() + int(part[1]) :].startswith(b"\nendstream")


def test_a_pdf_states_its_period_beside_a_ruler_of_100_mm(tmp_path: Path) -> None:
    path = tmp_path / "wall.pdf"
    run("sinusoid", "-o", path, "--period-mm", 8.7, "--dpi", 72)
    pdf = path.read_bytes()
    assert b"100 mm: print at 100 %. sinusoid, period 8.700 mm" in pdf
    ruler = re.search(rb"w ([\d.]+) ([\d.]+) m ([\d.]+) ([\d.]+) l", pdf)
    assert ruler is not None
    left, _, right, _ = map(float, ruler.groups())
    assert (right - left) / 72 * 25.4 == pytest.approx(100, abs=1e-3)


@pytest.mark.parametrize("kind", ["perlin", "squares"])
def test_the_seed_decides_every_dot(kind: str, tmp_path: Path) -> None:
    for name, seed in (("a.pdf", 1), ("b.pdf", 1), ("c.pdf", 2)):
        run(kind, "-o", tmp_path / name, *SMALL, "--seed", seed)
    first, again, other = ((tmp_path / name).read_bytes() for name in ("a.pdf", "b.pdf", "c.pdf"))
    assert first == again
    assert (image_of(first) != image_of(other)).mean() > 0.2


def test_the_camera_sets_the_period() -> None:
    # 8 px of a camera of 2000 px focal length, 3 m away: 12 mm
    assert find_period_mm(None, 8, 3, 2000) == pytest.approx(12)
    assert find_period_mm(8.7, None, None, None) == 8.7


@pytest.mark.parametrize(
    "options", [(None, None, None, None), (None, 8, 3, None), (8.7, 8, 3, 2000), (8.7, 8, None, 1)]
)
def test_half_a_camera_is_not_enough(options: tuple) -> None:
    with pytest.raises(BadInputError, match="give either --period-mm"):
        find_period_mm(*options)


def test_paper_sizes() -> None:
    assert paper_mm("a3") == (297, 420)
    assert paper_mm("297x210mm") == (297, 210)
    with pytest.raises(BadInputError, match="'A9' is unknown"):
        paper_mm("A9")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--dpi", 36, "--period-mm", 1), "raise --dpi"),
        (("--dpi", 2400, "--period-mm", 1, "--paper", "A0"), "lower --dpi"),
        (("--period-mm", 9, "--margin-mm", 200), "leaves nothing"),
        (("--period-mm", 120), "too large for a page of"),
        (("--period-mm", "inf"), "too large for a page of"),
        (("--period-px", 8, "--range-m", "1e308", "--focal", 2000), "too large for a page of"),
        (("--period-mm", 9, "--paper", "letter"), "'letter' is unknown"),
    ],
)
def test_what_cannot_be_printed_is_said(arguments: tuple, message: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=message):
        run("squares", "-o", tmp_path / "a.pdf", *arguments)


def test_only_pdf_and_png(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"end the name in \.pdf or \.png"):
        run("squares", "-o", tmp_path / "a.svg", *SMALL)
