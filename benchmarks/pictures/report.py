"""The report of a run as Chromium shows it.

    python -m benchmarks.pictures report OUT -o docs/images/report_none.jpg

Writes it as a JPEG; `--screen` shows it in dark mode, on a phone, on a long page, or as it is
printed.
"""

import argparse
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from playwright.sync_api import sync_playwright

from geometry.image_files import write_image
from locate.pipeline.files import RunFiles

CHROMIUM = "chromium"
SOFTWARE_GL = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SCREENS: dict[str, dict[str, Any]] = {
    "desktop": {"viewport": {"width": 1100, "height": 800}},
    "dark": {"viewport": {"width": 1100, "height": 800}, "color_scheme": "dark"},
    "phone": {"viewport": {"width": 390, "height": 844}, "is_mobile": True},
    "page": {"viewport": {"width": 1100, "height": 1850}},
    "paper": {"viewport": {"width": 780, "height": 1100}},
}
LONGEST_MS = 300_000
QUALITY = 80


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--screen", choices=SCREENS, default="desktop")


def main(options: argparse.Namespace) -> None:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which(CHROMIUM), args=SOFTWARE_GL, timeout=LONGEST_MS
        )
        page = browser.new_context(**SCREENS[options.screen]).new_page()
        page.set_default_timeout(LONGEST_MS)
        page.goto(RunFiles(options.run).report.resolve().as_uri())
        page.locator("#printed-view[src^='data:']").wait_for(state="attached")
        if options.screen == "paper":
            page.emulate_media(media="print")
        shot = np.frombuffer(page.screenshot(), np.uint8)
        browser.close()
    picture = cv2.imdecode(shot, cv2.IMREAD_COLOR)
    write_image(options.output, np.asarray(picture), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
