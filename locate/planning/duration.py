"""How long a run would take, by what its stages cost on a machine that was measured."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import prod

import cv2
import numpy as np

from detect.flow import dis_matcher
from locate.pipeline.config import RunConfig
from locate.pipeline.detections import ENDS
from locate.pipeline.effort import Amounts
from locate.recording import Recording
from locate.recording.sampling import looked_step

SAMPLE_FRAMES, SAMPLE_MEASURED, SAMPLE_NEIGHBOURS = 60, 16, 8
"""Frames of the bundled sample, those that are measured, and their neighbours."""
SAMPLE_PIXELS = 640 * 480
"""Of one of its frames."""
START_S, POSES_S, DETECTIONS_S, FUSION_S, REPORT_S = 3.3, 12.6, 28.2, 12.3, 4.0
"""CPU s of the sample's stages, the medians of five runs (docs/accuracy.md, Cost)."""
FULL_SIZE_S = 6.2
"""What the sample would take if all its pixels were measured at full size once more, CPU s."""
COMPARED_SHARE = 0.7
"""Of the time of detections, what grows with the neighbours."""
DISPLACEMENT_SHARE = 0.4
"""What the displacement of a frame takes, of what measuring all of it takes."""
AGAIN_S = 12.5
"""What fusing again takes for each `SAMPLE_MEASURED` more frames, CPU s."""
SIFT_FACTOR = 2.2
"""Of the time of poses, where frames are tied by SIFT, as photos mostly are (docs/accuracy.md)."""
FEATURES_SHARE = 0.12
"""Of the time of poses, what grows with the pixels: finding features."""
REFERENCE_S = 0.065
"""CPU s of `_work_once` on that machine."""
TRIES = 3
"""Of `_work_once`; the fastest counts."""
DECODED_FRAMES = 20
"""Frames that are decoded to see what one costs."""
LOOK_S = 0.024
"""CPU s of looking at a frame that is a grey image, on the machine of the sample: a profile of 1800
frames of 1920x1440."""


@dataclass(frozen=True, kw_only=True)
class RunTime:
    """CPU seconds of the stages of a run, about; a busy machine takes twice those of an idle one.

    Attributes:
        frames_s: Reading every frame and choosing.
        poses_s: Structure from motion; nothing of it where poses are given.
        detections_s: Measuring refraction.
        rest_s: Start-up, fusion and report.
        more_s: Measuring the displacement of more frames and fusing again.
    """

    frames_s: float
    poses_s: float
    detections_s: float
    rest_s: float
    more_s: float

    @property
    def total_s(self) -> float:
        """Of all stages where no more frames are measured."""
        return self.frames_s + self.poses_s + self.detections_s + self.rest_s


def describe_run(config: RunConfig, recording: Recording) -> str:
    """What a run will look at, and how long that takes, in one line.

    Raises:
        BadInputError: The frames cannot be read.
    """
    took = estimate_run_time(recording, config.amounts)
    always = config.effort == "thorough"
    total_s = took.total_s + (took.more_s if always else 0.0)
    if_unsure = f", {duration_text(took.more_s)} more if the answer is unsure"
    return (
        f"Effort {config.effort}: {config.amounts.describe()}; "
        f"about {duration_text(total_s)} of processor time"
        f"{if_unsure if took.more_s and not always else ''}."
    )


def duration_text(seconds: float) -> str:
    """A length of time in a word or two."""
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def estimate_run_time(recording: Recording, amounts: Amounts) -> RunTime:
    """What a run of this recording would take on this machine.

    Reading is timed on the first frames. The other stages are those of the bundled sample, by
    their frames and pixels, times what one piece of optical flow takes here over what it took
    where the sample was measured.

    Raises:
        BadInputError: The frames cannot be read.
    """
    count = recording.expected_frames or amounts.max_frames
    kept = min(count, amounts.max_frames)
    measured = min(kept, amounts.detection_frames)
    more = min(max(0, kept - measured - 2 * ENDS), amounts.displacement_frames)
    pixels = recording.width * recording.height / SAMPLE_PIXELS
    full_pixels = prod(recording.sizes.full) / SAMPLE_PIXELS
    compared = amounts.neighbours / SAMPLE_NEIGHBOURS
    full_s = FULL_SIZE_S * full_pixels * compared if recording.sizes.has_full_size else 0.0
    speed = min(_timed(_work_once) for _ in range(TRIES)) / REFERENCE_S
    tying = 1.0 if recording.is_video else SIFT_FACTOR
    growth = 1 + FEATURES_SHARE * (pixels - 1)
    return RunTime(
        frames_s=_choosing_s(recording, count, amounts.max_frames, speed * LOOK_S),
        poses_s=speed * tying * POSES_S * kept / SAMPLE_FRAMES * growth,
        detections_s=speed
        * (measured / SAMPLE_MEASURED)
        * (DETECTIONS_S * pixels * (COMPARED_SHARE * compared + 1 - COMPARED_SHARE) + full_s),
        rest_s=speed * (START_S + FUSION_S * measured / SAMPLE_MEASURED + REPORT_S),
        more_s=speed
        * (more / SAMPLE_MEASURED)
        * (DISPLACEMENT_SHARE * (DETECTIONS_S * pixels + full_s) + AGAIN_S),
    )


def _choosing_s(recording: Recording, count: int, max_frames: int, look_s: float) -> float:
    """Of reading so many frames, looking at some, and writing the key frames chosen among these."""
    read_s = _seconds_a_frame(recording, every=1)
    written_s = min(count, max_frames) * read_s
    if not recording.is_video:
        return count * (read_s + look_s) + written_s
    step = looked_step(count, max_frames)
    decoded_s = read_s
    if step > 1:
        decoded_s = min(read_s, _seconds_a_frame(recording, every=DECODED_FRAMES))
    return count * decoded_s + count / step * (read_s - decoded_s + look_s) + written_s


def _seconds_a_frame(recording: Recording, *, every: int) -> float:
    """Of reading a frame, where one of so many is made a grey image."""
    frames = recording.frames(lambda index, _: index % every == 0)
    next(frames)
    start, read = time.process_time(), 0
    for frame in frames:
        read = frame.index
        if read >= DECODED_FRAMES:
            break
    return (time.process_time() - start) / max(read, 1)


def _timed(work: Callable[[], None]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _work_once() -> None:
    """Optical flow between two images of the sample's size, as the detector computes it."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (480, 640), dtype=np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 2)
    moved = np.roll(image, 2, axis=1)
    dis_matcher(refinements=0).calc(image, moved, np.zeros((480, 640, 2), np.float32))
