"""What recordings showed of stated probabilities, as a picture."""

from collections.abc import Sequence

import cv2
import numpy as np

from benchmarks.common.plots import Colour, text
from benchmarks.reliability.outcomes import RecordingOutcome, Share
from benchmarks.reliability.tables import by_column, by_plume, found_over_limit, split_by_plume

NATS = (0.3, 1, 3, 10, 30, 100)
WIDTH, HEIGHT = 400, 300
LEFT, RIGHT, TOP, BOTTOM = 50, 385, 40, 240
STATED, FLOOR = (0, 0, 0), (150, 150, 150)
COLUMN, MAP = (200, 120, 30), (60, 160, 60)
PLUME, NONE = COLUMN, (60, 60, 220)


def picture(every: Sequence[RecordingOutcome]) -> np.ndarray:
    return np.hstack([stated_panel(every), nats_panel(every), limit_panel(every)])


def stated_panel(every: Sequence[RecordingOutcome]) -> np.ndarray:
    image = panel("A plume stands there, by what is stated (black)")
    bins = list(zip(by_column(every), by_plume(every), strict=True))
    for k, pair in enumerate(bins):
        middle = slot(k, len(bins))
        name = f"{pair[0].low:g}-{pair[0].high:g}"
        text(image, name, (middle - 3 * len(name), BOTTOM + 18))
        for each, aside, colour in zip(pair, (-14, 14), (COLUMN, MAP), strict=True):
            draw(image, middle + aside, each.true, colour)
            if each.true.count:
                at = row(each.stated)
                ends = (middle + aside - 9, at), (middle + aside + 9, at)
                cv2.line(image, *ends, STATED, 2, cv2.LINE_AA)
    text(image, "strongest column", (60, BOTTOM + 54), COLUMN)
    text(image, "strongest plume, no level or floor", (180, BOTTOM + 54), MAP)
    return image


def limit_panel(every: Sequence[RecordingOutcome]) -> np.ndarray:
    image = panel("Plumes found, by strength over the stated limit")
    shares = found_over_limit(every)
    for k, (low, high, share) in enumerate(shares):
        column = slot(k, len(shares))
        text(image, f"{low:g}-{high:g}", (column - 18, BOTTOM + 18))
        draw(image, column, share, MAP)
    return image


def nats_panel(every: Sequence[RecordingOutcome]) -> np.ndarray:
    image = panel("Share of recordings below, strongest column")
    for value in NATS:
        text(image, f"{value:g}", (along(value) - 8, BOTTOM + 18))
    text(image, "nats a view", (180, BOTTOM + 36))
    for floor in {one.floor_nats / one.views for one in every}:
        cv2.line(image, (along(floor), TOP), (along(floor), BOTTOM), FLOOR, 1, cv2.LINE_AA)
        text(image, "floor", (along(floor) + 4, row(0.5)), FLOOR)
    for some, name, colour, x in zip(
        split_by_plume(every), ("plume", "none"), (PLUME, NONE), (60, 120), strict=True
    ):
        nats = np.sort([one.strongest.nats / one.views for one in some])
        steps = [(along(n), row((k + up) / len(nats))) for k, n in enumerate(nats) for up in (0, 1)]
        cv2.polylines(
            image, [np.array(steps, np.int32).reshape(-1, 2)], False, colour, 2, cv2.LINE_AA
        )
        text(image, name, (x, BOTTOM + 36), colour)
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


def along(nats: float) -> int:
    """The column of an amount of evidence a view, on a logarithmic axis."""
    low, high = np.log(NATS[0]), np.log(NATS[-1])
    place = (np.log(max(nats, NATS[0])) - low) / (high - low)
    return round(float(LEFT + min(place, 1.0) * (RIGHT - LEFT)))
