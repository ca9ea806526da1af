"""The report as people open it: in Chromium, with axe-core, on a screen, a phone and paper."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from geometry.arrays import Picture
from locate.export.report import ColouredPoints, ReportFrame, write_report
from locate.journal.costs import StageTime
from locate.map.answer import Cause, Obstacle
from locate.map.plume import PlumeMap
from tests.locate.answers import SOURCE, orbit, plume, plume_map

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium; apt-get install chromium")

SOFTWARE_GL = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
LONGEST_MS = 300_000
DESKTOP: dict[str, Any] = {"viewport": {"width": 1280, "height": 900}}
DARK = DESKTOP | {"color_scheme": "dark"}
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "is_mobile": True}
DRAWN = "#printed-view[src^='data:']"
LARGER = (".frames", "#viewer-picture")
HELSINKI = {
    "origin_lat_deg": 60.0,
    "origin_lon_deg": 25.0,
    "origin_height_m": 10.0,
    "height_datum": "WGS84 ellipsoid",
}
NOISE = Obstacle(cause=Cause.NOISE, why="All was dark.", remedy="Film by day.")
ANSWERS = {
    "plume": plume_map(plume(), georeference=HELSINKI, notes=("A note.",)),
    "none": plume_map(),
    "nothing judged": plume_map(detection_limit_px=None, obstacles=(NOISE,)),
}


def write(path: Path, answer: PlumeMap) -> None:
    rng = np.random.default_rng(0)
    llr = np.zeros((48, 64), dtype=np.float32)
    llr[10:30, 20:30] = 4.0
    frames = [
        ReportFrame(
            index=index,
            label=f"{index / 10:.2f} s, frame {index}",
            picture=rng.integers(0, 255, (48, 64, 3), dtype=np.uint8),
            llr=llr,
            displacement=rng.normal(0, 0.1, (24, 32, 2)).astype(np.float32),
            source_px=np.array([[25.0, 30.0]]),
        )
        for index in (0, 2, 5, 8)
    ]
    voxels = SOURCE + rng.normal(0, 0.05, (60, 3)) if answer.plumes else np.zeros((0, 3))
    write_report(
        path,
        plume_map=answer,
        trajectory=orbit(),
        points=ColouredPoints.grey(rng.normal(0, 1, (300, 3))),
        voxels_in_world=voxels,
        voxel_probability=np.full(len(voxels), 0.9),
        frames=frames,
        stages=[StageTime(name="poses", wall_s=3.0, cpu_s=4.5, note="12 of 12")],
        settings={"recording": "a_long_name_of_a_video/without_any_place_to_break_it.mp4"},
    )


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("reports")
    for name, answer in ANSWERS.items():
        write(folder / f"{name}.html", answer)
    return {name: folder / f"{name}.html" for name in ANSWERS}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_GL)
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser: Any, reports: dict[str, Path]) -> Iterator[Any]:
    """Opens a report and waits until its scene is drawn; what the page complains of is an error."""
    contexts, complaints = [], []

    def open_report(name: str, screen: dict[str, Any] = DESKTOP) -> Any:
        context = browser.new_context(**screen)
        contexts.append(context)
        context.set_default_timeout(LONGEST_MS)
        page = context.new_page()
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda said: said.type == "error" and complaints.append(said.text))
        page.on("request", lambda to: to.url.startswith("http") and complaints.append(to.url))
        page.goto(reports[name].as_uri())
        page.locator(DRAWN).wait_for(state="attached")
        return page

    yield open_report
    for context in contexts:
        context.close()
    assert complaints == []


def pixels(shot: bytes) -> Picture:
    picture = cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture, dtype=np.uint8)


def orange_share(picture: Picture) -> float:
    """Of the pixels that have the colour of the first plume, laid over anything."""
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    return float(((red > green + 30) & (green > blue + 10)).mean())


def visible_frames(page: Any) -> int:
    return int(page.locator(".frames figure:visible").count())


@pytest.mark.parametrize(
    ("name", "screen"),
    [
        *(("plume", screen) for screen in (DESKTOP, DARK, PHONE)),
        *(("nothing judged", screen) for screen in (DESKTOP, PHONE)),
        ("none", DESKTOP),
    ],
)
def test_axe_has_no_serious_finding(opened: Any, name: str, screen: dict[str, Any]) -> None:
    page = opened(name, screen)
    page.check("#show-displacement")
    judged = axe.Axe().run(page).response
    assert len(judged["passes"]) > 20
    grave = [
        (one["id"], [node["html"][:200] for node in one["nodes"][:3]])
        for one in judged["violations"]
        if one["impact"] in ("serious", "critical")
    ]
    assert grave == []


@pytest.mark.parametrize(
    ("name", "headline"),
    [
        ("plume", "One plume found"),
        ("none", "No plume found"),
        ("nothing judged", "Nothing could be judged"),
    ],
)
def test_the_scene_is_drawn_under_its_answer(opened: Any, name: str, headline: str) -> None:
    page = opened(name)
    assert page.locator("h1").text_content() == headline
    shot = pixels(page.locator("#view canvas").first.screenshot())
    assert len(np.unique(shot.reshape(-1, 3), axis=0)) > 50
    assert (orange_share(shot) > 0.001) == (name == "plume")


def test_frames_open_larger_and_turn_by_key_and_button(opened: Any) -> None:
    page = opened("plume")
    page.locator(".larger").nth(1).click()
    caption = page.locator("#viewer-caption")
    assert caption.text_content() == "0.20 s, frame 2, saw plume 1 (2 of 4)"
    small, large = (page.locator(f"{one} .stack").first.bounding_box() for one in LARGER)
    assert large["width"] > 2 * small["width"]
    bottom = large["y"] + large["height"]
    assert bottom < DESKTOP["viewport"]["height"]
    page.keyboard.press("ArrowRight")
    assert caption.text_content() == "0.50 s, frame 5 (3 of 4)"
    page.get_by_role("button", name="Previous").click()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    assert caption.text_content() == "0.00 s, frame 0, saw plume 1 (1 of 4)"
    page.keyboard.press("Escape")
    assert not page.locator("#viewer").is_visible()


def test_a_click_in_the_scene_leads_to_the_frames(opened: Any) -> None:
    page = opened("plume")
    click = "document.getElementById('view').emit('plotly_click', {points: [{data: {meta: %s}%s}]})"
    page.evaluate(click % ("{click: 'plume', plume: 1}", ""))
    assert visible_frames(page) == 2
    page.evaluate(click % ("{click: 'frame'}", ", customdata: 6"))
    assert visible_frames(page) == 4
    assert page.locator("#viewer-caption").text_content() == "0.50 s, frame 5 (3 of 4)"


def test_evidence_and_displacement_are_shown_as_asked(opened: Any) -> None:
    page = opened("plume")
    assert page.locator(".frames .evidence:visible").count() == 4
    assert page.locator(".frames .displacement:visible").count() == 0
    page.uncheck("#show-evidence")
    page.check("#show-displacement")
    assert page.locator(".frames .evidence:visible").count() == 0
    assert page.locator(".frames .displacement:visible").count() == 4


def test_a_phone_shows_all_without_scrolling_sideways(opened: Any) -> None:
    page = opened("plume", PHONE)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert page.locator("#view .legend").count() == 0
    page.locator(".larger").first.click()
    assert page.locator("#viewer-picture .stack").first.bounding_box()["width"] > 250


def test_paper_shows_a_picture_of_the_whole_scene_in_light_colours(opened: Any) -> None:
    page = opened("plume", DARK)
    page.emulate_media(media="print", color_scheme="dark")
    assert not page.locator("#view").is_visible()
    shot = pixels(page.locator("#printed-view").screenshot())
    assert orange_share(shot) > 0.001
    assert np.median(shot) > 240
