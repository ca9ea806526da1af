"""What recordings showed of stated probabilities, as a picture."""

from collections.abc import Sequence

import cv2
import numpy as np

from benchmarks.common.plots import Colour, text
from benchmarks.reliability.outcomes import RecordingOutcome, Share
from benchmarks.reliability.tables import by_probability, found_over_limit

WIDTH, HEIGHT = 400, 300
LEFT, RIGHT, TOP, BOTTOM = 50, 385, 40, 240
STATED, SHARE = (0, 0, 0), (200, 120, 30)


def picture(every: Sequence[RecordingOutcome]) -> np.ndarray:
    return np.hstack([stated_panel(every), limit_panel(every)])


def stated_panel(every: Sequence[RecordingOutcome]) -> np.ndarray:
    image = panel("Surest column is a plume, by what is stated (black)")
    bins = by_probability(every)
    for k, each in enumerate(bins):
        middle, name = slot(k, len(bins)), f"{each.low:g}-{each.high:g}"
        text(image, name, (middle - 3 * len(name), BOTTOM + 18))
        draw(image, middle, each.true, SHARE)
        if each.true.count:
            at = row(each.stated)
            cv2.line(image, (middle - 12, at), (middle + 12, at), STATED, 2, cv2.LINE_AA)
    return image


def limit_panel(every: Sequence[RecordingOutcome]) -> np.ndarray:
    image = panel("Plumes found, by displacement over the stated limit")
    shares = found_over_limit(every)
    for k, (low, high, share) in enumerate(shares):
        middle = slot(k, len(shares))
        text(image, f"{low:g}-{high:g}", (middle - 18, BOTTOM + 18))
        draw(image, middle, share, SHARE)
    return image


def panel(title: str) -> np.ndarray:
    """Empty, with lines at shares from 0 to 1."""
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    text(image, title, (LEFT, 20))
    for share in np.arange(0, 1.01, 0.2):
        cv2.line(image, (LEFT, row(share)), (RIGHT, row(share)), (225, 225, 225), 1)
        text(image, f"{share:.1f}", (18, row(share) + 4))
    return image


def draw(image: np.ndarray, column: int, share: Share, colour: Colour) -> None:
    """A share with its interval and what it is of."""
    text(image, f"{share.count}", (column - 6, BOTTOM + 36))
    if share.count:
        low, high = share.interval
        cv2.line(image, (column, row(low)), (column, row(high)), colour, 1, cv2.LINE_AA)
        cv2.circle(image, (column, row(share.hits / share.count)), 5, colour, -1, cv2.LINE_AA)


def row(share: float) -> int:
    return round(BOTTOM - share * (BOTTOM - TOP))


def slot(k: int, count: int) -> int:
    return round(LEFT + (k + 0.5) * (RIGHT - LEFT) / count)
