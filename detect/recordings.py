"""The ground-truth maker: a recording before a known background becomes (frame, flow) pairs.

Source: the DYBS paper, section II.
"""

import json
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from detect.bos import mean_reference, texture_of, unbiased_flow
from detect.bos_checks import FrameCheck, RecordingFault, reference_fault
from detect.flow import Flow, flow_method
from detect.pair_writer import PairWriter, crop_corners, pairs_index, remove_recording
from detect.synthesis.split import Split, split_of_name
from geometry.arrays import GreyImage
from geometry.errors import BadInputError, UnwritableError

SCHEMA = "locate.recording/1"
PEAK_PERCENTILE = 99.9
MOST_FAULTY_SHARE = 0.1
SOONEST_VERDICT = 10


@dataclass(frozen=True, kw_only=True)
class PairSettings:
    """How a recording becomes pairs.

    Attributes:
        flow: Name of a flow method (`detect.flow.METHODS`) or path of an .onnx flow network.
        size_px: Side of the square crops; together they cover the frame.
        every: Of so many frames, one is used.
        split: Where the recording goes; None lets its name decide.
    """

    flow: str = "horn-schunck"
    size_px: int = 480
    every: int = 1
    split: Split | None = None


@dataclass(frozen=True, kw_only=True)
class MeasuredFrame:
    """One frame: its index, its largest displacement (99.9th percentile, px), its checks."""

    index: int
    peak_px: float
    check: FrameCheck

    def to_plain(self) -> dict[str, Any]:
        """As JSON knows it."""
        fault = self.check.fault
        name = None if fault is None else fault.name.lower()
        return {
            "index": self.index,
            "peak_px": self.peak_px,
            "fault": name,
            **asdict(self.check),
        }


@dataclass(frozen=True, kw_only=True)
class RecordedPairs:
    """What became of one recording.

    Attributes:
        name: Of the recording.
        split: Where it went, or would have gone.
        frames: Every frame that was measured.
        crops: How many samples were written.
        fault: Why the recording was refused, None where it was kept.
    """

    name: str
    split: Split
    frames: tuple[MeasuredFrame, ...]
    crops: int
    fault: RecordingFault | None

    @property
    def kept(self) -> tuple[MeasuredFrame, ...]:
        """The frames that are in the dataset."""
        good = tuple(frame for frame in self.frames if frame.check.fault is None)
        return () if self.fault else good


def record_pairs(
    name: str,
    images: Iterator[GreyImage],
    reference: GreyImage | int,
    folder: Path,
    settings: PairSettings,
) -> RecordedPairs:
    """Measures every frame against the reference and adds the recording to the dataset in FOLDER.

    What the dataset held of a recording of that name is replaced. Frames with a fault are left
    out. Where the reference has one, or more than a tenth of the frames, the whole recording is
    refused: only its report is written.

    Args:
        name: Of the recording; decides the split.
        images: (H, W) frames in order.
        reference: (H, W) the view without plume, or how many frames at the start show it.
        folder: Of the dataset, made where it is missing; docs/laboratory.md describes it.
        settings: How.

    Raises:
        BadInputError: Too few or too small frames, a reference of another size, or a folder that
            holds something else.
    """
    split = settings.split or split_of_name(name)
    pairs_index(folder / split, settings.size_px)
    flow, frames = flow_method(settings.flow), enumerate(images)
    still: list[GreyImage] = []
    if isinstance(reference, int):
        still = [image for _, image in islice(frames, reference)]
        if len(still) < reference:
            raise BadInputError(f"{name}: {len(still)} frames, fewer than its reference takes")
        reference = mean_reference(still)
    crop_corners(reference.shape, settings.size_px)
    fault = reference_fault(reference, still)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as scratch:
        writer = PairWriter(Path(scratch), name, settings.size_px)
        measured: list[MeasuredFrame] = []
        if fault is None:
            chosen = islice(frames, 0, None, settings.every)
            measured = _measure_frames(name, chosen, reference, flow, writer)
            fault = _common_fault(measured)
        remove_recording(folder, name)
        if fault is None:
            writer.publish_shards(folder, split)
    pairs = RecordedPairs(
        name=name,
        split=split,
        frames=tuple(measured),
        crops=0 if fault else writer.crops,
        fault=fault,
    )
    _write_report(pairs, reference, settings, folder / "recordings")
    return pairs


def _measure_frames(
    name: str,
    frames: Iterator[tuple[int, GreyImage]],
    reference: GreyImage,
    flow: Flow,
    writer: PairWriter,
) -> list[MeasuredFrame]:
    texture = texture_of(reference)
    measured: list[MeasuredFrame] = []
    for index, image in frames:
        if image.shape != reference.shape:
            raise BadInputError(
                f"{name}: frames are {image.shape}, the reference {reference.shape}: "
                "they must be of one size"
            )
        displacement, bias_px = unbiased_flow(flow, reference, image, texture)
        check = FrameCheck.compare(reference, image, displacement, bias_px, texture)
        peak_px = float(np.percentile(np.linalg.norm(displacement, axis=-1), PEAK_PERCENTILE))
        measured.append(MeasuredFrame(index=index, peak_px=peak_px, check=check))
        if check.fault is None:
            writer.add_crops(index, image, displacement)
        elif len(measured) >= SOONEST_VERDICT and _faulty_share(measured) > 0.5:
            break
    if not measured:
        raise BadInputError(f"{name}: no frames are left after those of the reference")
    return measured


def _faulty_share(frames: list[MeasuredFrame]) -> float:
    return sum(frame.check.fault is not None for frame in frames) / len(frames)


def _common_fault(frames: list[MeasuredFrame]) -> RecordingFault | None:
    """The commonest fault where too many frames have one."""
    faults = Counter(frame.check.fault for frame in frames if frame.check.fault)
    return faults.most_common(1)[0][0] if _faulty_share(frames) > MOST_FAULTY_SHARE else None


def _write_report(
    pairs: RecordedPairs, reference: GreyImage, settings: PairSettings, folder: Path
) -> None:
    """Writes NAME.json with every frame's figures, and the reference as NAME.png."""
    content = {
        "schema": SCHEMA,
        "name": pairs.name,
        "split": pairs.split,
        "fault": pairs.fault and pairs.fault.value,
        "settings": asdict(settings),
        "crops": pairs.crops,
        "frames": [frame.to_plain() for frame in pairs.frames],
    }
    _, png = cv2.imencode(".png", reference)
    try:
        folder.mkdir(exist_ok=True)
        (folder / f"{pairs.name}.png").write_bytes(png.tobytes())
        (folder / f"{pairs.name}.json").write_text(json.dumps(content, indent=1))
    except OSError as error:
        raise UnwritableError.of(folder, error) from error
