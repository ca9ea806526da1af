import json
import re
from base64 import b64decode, b64encode
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from geometry.arrays import FloatArray, Picture
from geometry.trajectory import Trajectory
from locate.export.report import ColouredPoints, ReportFrame, shapes, write_report
from locate.export.report.pictures import evidence_uri
from locate.journal.costs import StageTime
from locate.map.answer import Cause, Obstacle
from locate.map.plume import PlumeMap
from tests.locate.answers import SOURCE, bearing_ahead, orbit, plume, plume_map

VOID = {"meta", "img", "br", "input", "circle", "path", "polygon", "polyline"}
NOTHING = np.zeros((0, 3))


class Page(HTMLParser):
    """Collects the attributes of every tag, and checks that tags close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self._open):
            self.words.append(data)


def report(
    path: Path,
    answer: PlumeMap,
    trajectory: Trajectory | None,
    *,
    points: FloatArray = NOTHING,
    **changes: Any,
) -> str:
    picture = np.full((48, 64, 3), (30, 90, 150), dtype=np.uint8)
    llr = np.zeros((48, 64), dtype=np.float32)
    llr[10:30, 20:30] = 4.0
    displacement = np.zeros((24, 32, 2), dtype=np.float32)
    displacement[5:15, 10:15] = (0.4, 0.0)
    frames = [
        ReportFrame(
            index=index,
            label=f"{index / 10:.2f} s, frame {index}",
            picture=picture,
            llr=llr,
            displacement=displacement,
            source_px=np.array([[25.0, 30.0]]),
        )
        for index in (2, 3)
    ]
    fields: dict[str, Any] = {
        "plume_map": answer,
        "trajectory": trajectory,
        "points": ColouredPoints.grey(points),
        "voxels_in_world": np.array([[0.0, 0.0, 0.5]]),
        "voxel_probability": np.array([0.9]),
        "frames": frames,
        "stages": [StageTime(name="poses", wall_s=3.0, cpu_s=4.5, note="12 of 12")],
        "settings": {"input": "<a&b>.mp4"},
    }
    if "coloured" in changes:
        fields["points"] = changes.pop("coloured")
    write_report(path, **fields | changes)
    return path.read_text()


def figure(text: str) -> dict[str, Any]:
    block = re.search(r'<script type="application/json" id="figure">(.*?)</script>', text)
    assert block is not None
    content: dict[str, Any] = json.loads(block[1])
    return content


def decoded(uri: str) -> Picture:
    data = np.frombuffer(b64decode(uri.split(",", 1)[1]), dtype=np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return np.asarray(picture, dtype=np.uint8)


def unpacked(trace: dict[str, Any]) -> FloatArray:
    columns = [np.frombuffer(b64decode(trace[key]["bdata"]), dtype="<f4") for key in "xyz"]
    return np.stack(columns, axis=-1).astype(float)


def test_the_page_needs_nothing_from_outside(tmp_path: Path) -> None:
    text = report(tmp_path / "report.html", plume_map(plume()), orbit())
    page = Page(text)
    loaded = [attrs["src"] for _, attrs in page.tags if "src" in attrs]
    assert loaded
    assert all(link and link.startswith("data:image/") for link in loaded)
    assert not {"link", "iframe", "object", "embed"} & {tag for tag, _ in page.tags}
    policy = next(attrs["content"] for _, attrs in page.tags if "http-equiv" in attrs)
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert text.count("plotly.js v") == 1
    assert len(text) < 6e6


def policy_of(text: str) -> dict[str, list[str]]:
    """The content-security policy of a page: what is allowed, by directive."""
    content = next(attrs["content"] for _, attrs in Page(text).tags if "http-equiv" in attrs)
    assert content is not None
    parts = [part.split() for part in content.split(";")]
    return {name: allowed for name, *allowed in parts}


@pytest.mark.parametrize("trajectory", [orbit(), None])
def test_only_the_scripts_of_the_page_itself_may_run(
    tmp_path: Path, trajectory: Trajectory | None
) -> None:
    hostile = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\x1b[2J"
    answer = plume_map(plume(), notes=(hostile,), detector=hostile)
    text = report(
        tmp_path / "report.html", answer, trajectory, settings={hostile: hostile}, notes=[hostile]
    )
    policy = policy_of(text)
    assert policy["default-src"] == policy["base-uri"] == policy["form-action"] == ["'none'"]
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    hashes = [sha256(script.encode()).digest() for script in scripts]
    expected = [f"'sha256-{b64encode(one).decode()}'" for one in hashes] or ["'none'"]
    assert policy["script-src"] == expected
    assert not any("alert" in script or "\r" in script for script in scripts)
    tags = Page(text).tags
    assert not any(name.startswith("on") for _, attrs in tags for name in attrs)
    assert not any(attrs.get("src") == "x" for _, attrs in tags)


def test_table_limits_and_times_are_in_the_text_itself(tmp_path: Path) -> None:
    text = report(
        tmp_path / "report.html",
        plume_map(plume(source_hidden=True), units="scene", notes=("Lengths are not metres.",)),
        orbit(),
        notes=["a note <of> the run"],
    )
    words = " ".join(Page(text).words)
    for expected in (
        *("One plume found", "0.300, -0.200, 0.100", "Lengths are not metres."),
        *("a plume of 0.25 px would have been seen in half", "a note <of> the run", "<a&b>.mp4"),
        *("Seen in half of the places", '"> 0.999" is an extrapolation'),
        *("is hidden from the camera", "poses", "4.5", "12 of 12", "0.10 scene units above"),
    ):
        assert expected in words, expected


def test_the_scene_holds_cameras_and_the_plume_where_they_are(tmp_path: Path) -> None:
    trajectory = orbit()
    traces = {
        trace["name"]: trace
        for trace in figure(report(tmp_path / "r.html", plume_map(plume()), trajectory))["data"]
    }
    np.testing.assert_allclose(
        unpacked(traces["camera path"]), trajectory.centers_in_world, atol=1e-5
    )
    np.testing.assert_allclose(unpacked(traces["source 1"])[0], SOURCE, atol=1e-6)
    assert np.linalg.norm(unpacked(traces["plume 1"])[0] - SOURCE) == pytest.approx(0.05, rel=1e-3)
    assert "source 1, 2 sigma" in traces


def test_a_click_leads_to_the_frames(tmp_path: Path) -> None:
    text = report(tmp_path / "r.html", plume_map(plume()), orbit())
    traces = figure(text)["data"]
    opened = [trace for trace in traces if trace.get("meta") == {"click": "frame"}]
    assert [2] in [trace["customdata"] for trace in opened]
    (voxels,) = (trace for trace in traces if trace["name"] == "evidence")
    assert (voxels["meta"], voxels["customdata"]) == ({"click": "plume"}, [1])
    surface = next(trace for trace in traces if trace["name"] == "plume 1")
    assert surface["meta"] == {"click": "plume", "plume": 1}
    shown = [attrs for tag, attrs in Page(text).tags if tag == "figure"]
    assert [(one["data-frame"], one["data-plumes"]) for one in shown] == [("2", "1"), ("3", "")]
    words = " ".join(Page(text).words)
    assert "0.20 s, frame 2, saw plume 1" in words
    assert "1 saw plume 1" in words


def test_points_and_frames_are_in_colour(tmp_path: Path) -> None:
    point = ColouredPoints(np.array([[0.0, 0.0, 0.5]]), np.array([[200, 100, 50]], np.uint8))
    text = report(tmp_path / "r.html", plume_map(plume()), orbit(), points=point.in_world)
    assert figure(text)["data"][0]["marker"]["color"] == ["#8c8c8c"]
    text = report(tmp_path / "r.html", plume_map(plume()), orbit(), coloured=point)
    assert figure(text)["data"][0]["marker"]["color"] == ["#c86432"]
    filmed = next(
        attrs["src"] for _, attrs in Page(text).tags if "as filmed" in (attrs.get("alt") or "")
    )
    assert filmed is not None
    blue, green, red = decoded(filmed).mean(axis=(0, 1))
    assert (abs(blue - 30) < 8, abs(green - 90) < 8, abs(red - 150) < 8) == (True, True, True)


def test_axes_have_one_scale_and_stray_points_do_not_zoom_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate([rng.normal(size=(500, 3)), [[900.0, 0.0, 0.0]]])
    content = figure(report(tmp_path / "r.html", plume_map(plume()), orbit(), points=points))
    scene = content["layout"]["scene"]
    spans = {key: np.ptp(scene[f"{key}axis"]["range"]) for key in "xyz"}
    per_unit = [scene["aspectratio"][key] / spans[key] for key in "xyz"]
    np.testing.assert_allclose(per_unit, per_unit[0])
    low, high = scene["xaxis"]["range"]
    assert low < -1.0
    assert 8.0 < high < 20.0


def test_a_still_camera_has_bearings_and_no_scene(tmp_path: Path) -> None:
    answer = plume_map(bearings=(bearing_ahead(),), detection_limit_px=None)
    text = report(tmp_path / "r.html", answer, None)
    assert "plotly" not in text.lower()
    words = " ".join(Page(text).words)
    assert "1 direction to a plume" in words
    assert "directions, not positions" in words
    assert "One direction found." in words
    assert "not known" not in words


def test_nothing_found_and_nothing_kept_is_still_a_page(tmp_path: Path) -> None:
    text = report(
        tmp_path / "r.html",
        plume_map(),
        orbit(),
        voxels_in_world=NOTHING,
        voxel_probability=np.zeros(0),
        frames=[],
        stages=[],
    )
    words = " ".join(Page(text).words)
    assert "No plume found" in words
    assert "None found; a plume of 0.25 px would have been seen in half of the places." in words


def test_where_nothing_could_be_judged_the_page_states_why_and_what_to_film(
    tmp_path: Path,
) -> None:
    blurred = Obstacle(cause=Cause.NOISE, why="All was <dark>.", remedy="Film by day.")
    answer = plume_map(detection_limit_px=None, obstacles=(blurred,))
    words = " ".join(Page(report(tmp_path / "r.html", answer, orbit())).words)
    for expected in (
        *("Nothing could be judged", "All was <dark>.", "What to film instead", "Film by day."),
        "no plume of any strength",
    ):
        assert expected in words, expected
    assert "No plume found" not in words


def test_evidence_is_drawn_where_it_is_and_nowhere_else() -> None:
    llr = np.full((40, 60), -1.0, dtype=np.float32)
    llr[5:15, 30:50] = 4.0
    alpha = decoded(evidence_uri(llr, 4.0))[..., 3]
    assert alpha[8:12, 35:45].min() > 150
    assert alpha[20:, :].max() == 0


def test_the_ellipsoid_lies_at_its_sigma() -> None:
    covariance = plume().source_covariance
    vertices, triangles = shapes.ellipsoid_surface(SOURCE, covariance, 2.0)
    offset = vertices - SOURCE
    distances = np.einsum("vi,ij,vj->v", offset, np.linalg.inv(covariance), offset)
    np.testing.assert_allclose(distances, 4.0, rtol=1e-6)
    assert triangles.max() == len(vertices) - 1


def test_frusta_look_where_the_cameras_look() -> None:
    trajectory = orbit()
    wire = shapes.camera_frusta(trajectory, np.array([3]), 0.5)
    depth = trajectory.world_to_cam(3, wire[:4])
    np.testing.assert_allclose(depth[:, 2], 0.5)
    np.testing.assert_allclose(trajectory.camera.project(depth)[2], [63.0, 47.0], atol=1e-6)


GEOREFERENCE = {
    "origin_lat_deg": 60.0,
    "origin_lon_deg": 25.0,
    "origin_height_m": 10.0,
    "height_datum": "WGS84 ellipsoid",
}


def test_on_the_earth_the_page_states_coordinates_and_draws_a_plan(tmp_path: Path) -> None:
    answer = plume_map(plume(), georeference=GEOREFERENCE)
    text = report(tmp_path / "r.html", answer, orbit(), points=np.zeros((3, 3)))
    page = Page(text)
    words = " ".join(page.words)
    assert "59.9999982, 25.0000054" in words
    assert "10.1 m above" in words
    links = [attrs["href"] for tag, attrs in page.tags if tag == "a"]
    assert links == [
        "https://www.openstreetmap.org/?mlat=59.9999982&mlon=25.0000054"
        "#map=19/59.9999982/25.0000054",
        "geo:59.9999982,25.0000054",
    ]
    plan = re.search(r'<svg class="plan".*?</svg>', text, re.DOTALL)
    assert plan is not None
    assert ">N</text>" in plan[0]
    # The scale bar is as long as it states, on the scale of the camera's path.
    metres = float(re.search(r">([0-9.]+) m</text>", plan[0])[1])  # type: ignore[index]
    left, right = re.search(r"M([0-9.]+) [0-9.]+v-6v6H([0-9.]+)v-6", plan[0]).groups()  # type: ignore[union-attr]
    corners = re.search(r'<polyline class="path" points="([^"]*)"', plan[0])
    assert corners is not None
    path = np.array([pair.split(",") for pair in corners[1].split()], dtype=float)
    span_m = np.linalg.norm(np.subtract(*orbit().centers_in_world[[0, -1], :2]))
    span = np.linalg.norm(path[0] - path[-1])
    assert (float(right) - float(left)) / metres == pytest.approx(span / span_m, rel=0.01)
    assert path[-1, 1] < path[0, 1]  # the last camera stands further north: higher on the plan


def test_off_the_earth_there_is_no_plan(tmp_path: Path) -> None:
    text = report(tmp_path / "r.html", plume_map(plume()), orbit())
    assert "On the Earth" not in text


def test_the_overlay_video_is_named_where_there_is_one(tmp_path: Path) -> None:
    for video, count in (("overlay.mp4", 1), (None, 0)):
        text = report(tmp_path / "r.html", plume_map(plume()), orbit(), video=video)
        assert sum(attrs.get("href") == "overlay.mp4" for _, attrs in Page(text).tags) == count
