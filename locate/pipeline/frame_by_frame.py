"""Every frame of a recording, through one detector; the results as files and pictures."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from detect.detection import Detection, Detector, Frames
from detect.evidence import LLR_MAX
from geometry.atomic import atomic_path, is_unfinished, remove_unfinished, write_text_atomic
from geometry.errors import BadInputError
from geometry.lock import LOCK, hold_lock
from geometry.named_poses import read_camera
from geometry.pose_files import read_named_poses
from geometry.removal import remove_inside
from geometry.reports import Report, ignore_report
from geometry.text_files import read_json
from geometry.threads import with_one_thread
from locate.export.pictures import displacement_picture, overlay_evidence
from locate.recording.frame_files import FrameFiles
from locate.recording.images import write_png
from locate.recording.opening import ANY_SIDE, open_recording
from locate.recording.writer import create_video

SCHEMA = "locate.detections/1"
INDEX, VIDEO, SCRATCH = "index.json", "overlay.mp4", ".frames"
FOLDERS = ("detections", "masks", "pictures")
MASK_NATS = 2.0
"""A pixel with more evidence is in the mask, unless another level is asked for."""


@dataclass(frozen=True, kw_only=True)
class FrameSummary:
    """One frame in figures.

    Attributes:
        frame: Name of its files.
        largest_px: The largest displacement in its mask; 0 without one.
        mask_share: Share of its pixels in the mask.
        judged_share: Share of its pixels that hold evidence for or against.
    """

    frame: str
    largest_px: float
    mask_share: float
    judged_share: float

    @classmethod
    def of(cls, frame: str, detection: Detection, threshold_nats: float) -> "FrameSummary":
        """The figures of a detection."""
        mask = detection.llr > threshold_nats
        size = np.linalg.norm(detection.displacement[mask], axis=-1)
        return cls(
            frame=frame,
            largest_px=float(size.max(initial=0)),
            mask_share=float(mask.mean()),
            judged_share=float((detection.llr != 0).mean()),
        )


@with_one_thread
def detect_frames(
    path: Path,
    output: Path,
    detector: Detector,
    *,
    poses: Path | None = None,
    camera: Path | None = None,
    every: int = 1,
    threshold_nats: float = MASK_NATS,
    report: Report = ignore_report,
) -> list[FrameSummary]:
    """Writes detections, masks, pictures and a video of every frame.

    Args:
        path: An image, a folder of photos or a video.
        output: The folder to write; one that an earlier call wrote is written anew.
        detector: Measures the frames.
        poses: Of the frames, for a detector that needs them; frames without one are left out.
        camera: A JSON file with the camera of the poses.
        every: Of so many frames, one is measured; it is still compared with the others by a
            detector that compares frames.
        threshold_nats: A pixel with more evidence is in the mask.
        report: Takes the progress.

    Raises:
        BadInputError: Something given cannot be used, or OUTPUT holds something else.
    """
    recording = open_recording(path, max_side=ANY_SIDE)
    named = None
    if poses is not None:
        size = (recording.width, recording.height)
        named = read_named_poses(poses, None if camera is None else read_camera(camera, *size))
    with _claim_folder(output) as scratch:
        read_every = 1 if detector.uses_other_frames else every
        files = FrameFiles.of(recording, scratch, every=read_every)
        notes: tuple[str, ...] = ()
        if named is None:
            frames = files.frames()
        else:
            files, frames, notes = files.with_poses(named)
        rows = range(0, len(frames), every // read_every)
        summaries = _detect_each(frames, rows, files, detector, output, threshold_nats, report)
    content = {
        "schema": SCHEMA,
        "detector": detector.name,
        "threshold_nats": threshold_nats,
        "frames": [asdict(one) for one in summaries],
        "notes": (*recording.warnings, *notes),
    }
    write_text_atomic(output / INDEX, json.dumps(content, indent=1))
    return summaries


def _detect_each(
    frames: Frames,
    rows: range,
    files: FrameFiles,
    detector: Detector,
    output: Path,
    threshold_nats: float,
    report: Report,
) -> list[FrameSummary]:
    measured = files.select_rows(rows)
    sizes = {frames.images[row].shape for row in rows}
    summaries = []
    with ExitStack() as stack:
        video = None
        if len(rows) > 1 and len(sizes) == 1:
            height, width = sizes.pop()
            unfinished = stack.enter_context(atomic_path(output / VIDEO))
            fps = measured.fps
            video = stack.enter_context(create_video(unfinished, size=(width, height), fps=fps))
        for done, (row, label) in enumerate(zip(rows, measured.labels, strict=True)):
            report("detections", done / len(rows))
            detection = detector.detect(frames, row)
            _write_detection(detection, output, label, threshold_nats)
            summaries.append(FrameSummary.of(label, detection, threshold_nats))
            if video is not None:
                video.write(overlay_evidence(frames.images[row], detection.llr, LLR_MAX))
    report("detections", 1.0)
    return summaries


def _write_detection(detection: Detection, output: Path, label: str, threshold_nats: float) -> None:
    with atomic_path(output / "detections" / f"{label}.npz") as unfinished:
        detection.save(unfinished)
    mask = np.where(detection.llr > threshold_nats, np.uint8(255), np.uint8(0))
    write_png(output / "masks" / f"{label}.png", mask)
    measured = np.isfinite(detection.sigma_px)[..., None]
    shown = np.where(measured, detection.displacement, 0)
    write_png(output / "pictures" / f"{label}.png", displacement_picture(shown))


@contextmanager
def _claim_folder(output: Path) -> Iterator[Path]:
    """Empties OUTPUT of an earlier call's files; gives a folder that is gone afterwards."""
    with ExitStack() as stack:
        try:
            output.mkdir(parents=True, exist_ok=True)
            left = [path for path in output.iterdir() if not _is_hidden(path)]
            if left and not _was_written_here(output / INDEX):
                raise BadInputError(
                    f"{output}: not empty and not written by locate detect; "
                    "choose another folder with -o"
                )
            stack.enter_context(hold_lock(output))
            remove_unfinished(output)
            for name in (*FOLDERS, VIDEO, SCRATCH):
                remove_inside(output, name)
            write_text_atomic(output / INDEX, json.dumps({"schema": SCHEMA, "frames": []}))
            for name in (*FOLDERS, SCRATCH):
                (output / name).mkdir()
        except OSError as error:
            raise BadInputError(
                f"{output}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from error
        stack.callback(remove_inside, output, SCRATCH)
        yield output / SCRATCH


def _is_hidden(path: Path) -> bool:
    """Whether a file is the lock, or what a command that was killed at its first file left."""
    return path.name == LOCK or is_unfinished(path)


def _was_written_here(index: Path) -> bool:
    try:
        content: Any = read_json(index)
    except BadInputError:
        return False
    return isinstance(content, dict) and content.get("schema") == SCHEMA
