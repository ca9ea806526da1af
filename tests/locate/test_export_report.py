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

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.export.report import ReportFrame, shapes, write_report
from locate.export.report.pictures import evidence_uri
from locate.journal.costs import StageTime
from locate.map.answer import Cause, Obstacle
from locate.map.plume import Bearing, PlumeMap
from tests.locate.answers import SOURCE, orbit, plume, plume_map

VOID = {"meta", "img", "br", "input", "circle", "path"}
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
    image = np.full((48, 64), 90, dtype=np.uint8)
    llr = np.zeros((48, 64), dtype=np.float32)
    llr[10:30, 20:30] = 4.0
    frames = [ReportFrame(index=2, image=image, llr=llr, source_px=np.array([[25.0, 30.0]]))]
    fields: dict[str, Any] = {
        "plume_map": answer,
        "trajectory": trajectory,
        "points_in_world": points,
        "voxels_in_world": np.array([[0.0, 0.0, 0.5]]),
        "voxel_probability": np.array([0.9]),
        "frames": frames,
        "stages": [StageTime(name="poses", wall_s=3.0, cpu_s=4.5, note="12 of 12")],
        "settings": {"input": "<a&b>.mp4"},
    }
    write_report(path, **fields | changes)
    return path.read_text()


def figure(text: str) -> dict[str, Any]:
    block = re.search(r'<script type="application/json" id="figure">(.*?)</script>', text)
    assert block is not None
    content: dict[str, Any] = json.loads(block[1])
    return content


def unpacked(trace: dict[str, Any]) -> FloatArray:
    columns = [np.frombuffer(b64decode(trace[key]["bdata"]), dtype="<f4") for key in "xyz"]
    return np.stack(columns, axis=-1).astype(float)


def test_the_page_needs_nothing_from_outside(tmp_path: Path) -> None:
    text = report(tmp_path / "report.html", plume_map(plume()), orbit())
    page = Page(text)
    links = [attrs.get(key) for _, attrs in page.tags for key in ("src", "href") if key in attrs]
    assert links
    assert all(link and link.startswith("data:image/") for link in links)
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
    title = traces["evidence"]["marker"]["colorbar"]["title"]["text"]
    assert "evidence" in title
    assert "0.5 = none" in title


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
    bearing = Bearing(
        direction_in_cam=np.array([0.0, 0.0, 1.0]),
        sigma_rad=0.01,
        evidence_nats=9.0,
        probability=0.9,
        displacement_px=0.4,
    )
    answer = plume_map(bearings=(bearing,), detection_limit_px=None)
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
    uri = evidence_uri(llr, (60, 40), 4.0)
    data = np.frombuffer(b64decode(uri.split(",", 1)[1]), dtype=np.uint8)
    alpha = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)[..., 3]
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
