"""A camera file from a recording of a board."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatArray, GreyImage
from geometry.atomic import write_text_atomic
from geometry.calibration_board import CalibrationBoard
from geometry.errors import BadInputError
from geometry.lens_calibration import BoardView, LensCalibration, LensName, calibrate_lens
from geometry.reports import Report, ignore_report
from locate.recording.images import write_png
from locate.recording.opening import ANY_SIDE, open_recording
from locate.recording.recording import Recording

SCHEMA = "locate.camera/1"
MOST_LOOKED_AT, MOST_VIEWS = 120, 40
"""Frames in which the board is searched, and pictures of it that are used."""
APART = 0.03
"""How far the corners move between pictures that are used, over the longest side; by hand."""
ENLARGED = 100
"""Residuals are drawn so many times as long."""


@dataclass(frozen=True, kw_only=True)
class CalibrationFiles:
    """What was fitted and written.

    Attributes:
        found: The calibration.
        views: How many pictures of the board were used.
        camera: The JSON file, for ``--camera``.
        picture: Its residuals, .png.
    """

    found: LensCalibration
    views: int
    camera: Path
    picture: Path


def calibrate_recording(
    source: Path,
    board: CalibrationBoard,
    output: Path,
    *,
    lens: LensName | None = None,
    report: Report = ignore_report,
) -> CalibrationFiles:
    """Fits a camera to a recording of a board; writes it, and a picture of what it leaves.

    Args:
        source: A video, or a folder of photos of one size.
        board: What is seen in it.
        output: The .json to write; the picture has its name, .png.
        lens: The model; None takes the simplest that explains the boards.
        report: Takes the progress.

    Raises:
        BadInputError: The recording cannot be read, or shows too little of the board.
    """
    if output.suffix.lower() != ".json":
        raise BadInputError(f"{output}: give a name that ends in .json")
    recording = open_recording(source, max_side=ANY_SIDE, one_camera=True)
    views, last = _find_views(recording, board, report)
    size = (recording.width, recording.height)
    try:
        found = calibrate_lens(views, size, lens)
    except BadInputError as error:
        raise BadInputError(f"{source}: {error}") from error
    content = {
        "schema": SCHEMA,
        "camera": found.camera.to_dict(),
        "calibration": {
            "lens": found.lens,
            "rms_px": found.rms_px,
            "others_px": found.others_px,
            "views": [view.name for view in views],
        },
    }
    picture = output.with_suffix(".png")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        write_png(picture, _draw(last, views, found.residuals_px))
        write_text_atomic(output, json.dumps(content, indent=1))
    except OSError as error:
        raise BadInputError(f"{output}: cannot be written ({error.strerror})") from error
    return CalibrationFiles(found=found, views=len(views), camera=output, picture=picture)


def _find_views(
    recording: Recording, board: CalibrationBoard, report: Report
) -> tuple[list[BoardView], GreyImage]:
    """Pictures of the board that differ, and the last frame."""
    step = max(1, recording.expected_frames // MOST_LOOKED_AT)
    least_px = APART * max(recording.width, recording.height)
    views: list[BoardView] = []
    last = np.zeros((recording.height, recording.width), np.uint8)
    for number, frame in enumerate(recording.frames()):
        total = recording.expected_frames
        report("corners", min(1.0, number / total) if total else -1.0)
        if number % step or len(views) >= MOST_VIEWS:
            continue
        last = frame.image
        corners = board.find(frame.image)
        if corners is None:
            continue
        name = frame.source or f"frame {frame.index}"
        view = BoardView(name=name, on_board=corners.on_board, in_image=corners.in_image)
        if not views or min(_moved_px(view, each) for each in views) > least_px:
            views.append(view)
    report("corners", 1.0)
    return views, last


def _moved_px(view: BoardView, other: BoardView) -> float:
    """Mean distance of the corners that both show; infinite where these are none."""
    places = {tuple(place): row for row, place in enumerate(other.on_board.tolist())}
    common = [
        (row, places[tuple(place)])
        for row, place in enumerate(view.on_board.tolist())
        if tuple(place) in places
    ]
    if not common:
        return np.inf
    here, there = np.transpose(common)
    apart = view.in_image[here] - other.in_image[there]
    return float(np.linalg.norm(apart, axis=1).mean())


def _draw(
    image: GreyImage, views: list[BoardView], residuals_px: tuple[FloatArray, ...]
) -> NDArray[np.uint8]:
    """Every corner of every picture and its residual, `ENLARGED`, over a pale frame."""
    canvas = cv2.cvtColor(128 + image // 2, cv2.COLOR_GRAY2BGR)
    thick = max(1, max(image.shape) // 800)
    for view, residuals in zip(views, residuals_px, strict=True):
        starts, ends = np.rint(view.in_image), np.rint(view.in_image + ENLARGED * residuals)
        for start, end in zip(starts.astype(int).tolist(), ends.astype(int).tolist(), strict=True):
            cv2.line(canvas, start, end, (0, 80, 255), thick, cv2.LINE_AA)
            cv2.circle(canvas, start, 2 * thick, (120, 60, 0), -1, cv2.LINE_AA)
    return np.asarray(canvas, dtype=np.uint8)
