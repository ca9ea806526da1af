"""Which detectors a stored name means."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from detect.detection import Detector
from detect.fused import SEPARATOR, FusedDetector
from detect.kinds import (
    BOS,
    DYBS,
    REGISTERED,
    REGISTERED_PLAIN,
    DetectorInputs,
    DetectorKind,
    PlumeReliability,
)
from detect.registered import DisplacementOnlyDetector
from geometry.arrays import FloatArray, GreyImage
from geometry.errors import BadInputError

KINDS = {kind.name: kind for kind in (REGISTERED, REGISTERED_PLAIN, BOS, DYBS)}


@dataclass(frozen=True)
class DetectorChoice:
    """A detector, or one that another helps.

    Attributes:
        parts: One or two; the first decides what a plume must show, weights given are the last's.
    """

    parts: tuple[DetectorKind, ...]

    @classmethod
    def parse(cls, name: str) -> Self:
        """The choice of that name; ``a+b`` is a, helped by b.

        A detector of an unknown name has no rules of its own, and cannot be made.
        """
        parts = name.split(SEPARATOR, maxsplit=1)
        return cls(tuple(KINDS.get(part) or DetectorKind(name=part) for part in parts))

    @property
    def name(self) -> str:
        """As stored in index.json and map.json."""
        return SEPARATOR.join(part.name for part in self.parts)

    @property
    def clutter_nats(self) -> float:
        """What a plume must have for every view that was summed."""
        return self.parts[0].clutter_nats

    @property
    def reliability(self) -> PlumeReliability | None:
        """Caps the probability of plumes, where it is known."""
        return self.parts[0].reliability

    @property
    def has_information(self) -> bool:
        """Whether its detections hold the information of all pixels."""
        return self.parts[0] in (REGISTERED, REGISTERED_PLAIN)

    @property
    def takes_weights(self) -> bool:
        """Whether a file of weights may be given."""
        return self.parts[-1].takes_weights

    def helped_by_dybs(self, weights: Path | None) -> Self:
        """The same, helped by the single-frame detector where that has weights."""
        helper = KINDS[DYBS.name]
        if helper.find_weights(weights) is None:
            return self
        return type(self)((*self.parts, helper))

    def weight_files(self, weights: Path | None) -> list[Path]:
        """The files that `make` reads."""
        found = [part.find_weights(given) for part, given in self._weights_given(weights)]
        return [path for path in found if path is not None]

    def empty_frames_note(self, empty: int, frames: int, *, with_count: bool = True) -> str | None:
        """What to note where `empty` of the frames hold no evidence; None where nothing is.

        Without the count it says only what else to try.
        """
        first = self.parts[0]
        if not empty or first.empty_frames_note is None:
            return None
        count = first.empty_frames_note.format(empty=empty, frames=frames) if with_count else ""
        return f"{count} {first.empty_frames_advice or ''}".strip()

    def make(
        self,
        *,
        neighbours: int = 8,
        points_in_world: FloatArray | None = None,
        reference: GreyImage | None = None,
        weights: Path | None = None,
    ) -> Detector:
        """The detector itself.

        Args:
            neighbours: How many other frames ``registered`` compares each with.
            points_in_world: (N, 3) sparse points of the scene, for ``registered``.
            reference: (H, W), the view without plume, for ``bos``.
            weights: An .onnx file for the last part; None takes what is installed.

        Raises:
            BadInputError: There is no such detector, or its weights are missing or not its own.
        """
        inputs = DetectorInputs(
            neighbours=neighbours, points_in_world=points_in_world, reference=reference
        )
        first, *helpers = (part.make(inputs, given) for part, given in self._weights_given(weights))
        return FusedDetector(first, helpers[0]) if helpers else first

    def _weights_given(self, weights: Path | None) -> list[tuple[DetectorKind, Path | None]]:
        return [(part, weights if part is self.parts[-1] else None) for part in self.parts]


def make_displacement_only(
    name: str, *, neighbours: int = 8, points_in_world: FloatArray | None = None
) -> Detector:
    """What measures the displacement alone, for more frames than the detector of that name does.

    Args:
        name: Of a detector whose `DetectorChoice.has_information` holds.
        neighbours: As of `make_detector`.
        points_in_world: As of `make_detector`.

    Raises:
        BadInputError: That detector gives no information on the displacement.
    """
    if not DetectorChoice.parse(name).has_information:
        raise BadInputError(f"{name} measures no displacement that adds up over frames")
    return DisplacementOnlyDetector(neighbours=neighbours, points_in_world=points_in_world)


def make_detector(
    name: str,
    *,
    neighbours: int = 8,
    points_in_world: FloatArray | None = None,
    reference: GreyImage | None = None,
    weights: str | Path | None = None,
) -> Detector:
    """The detector of that name; see `DetectorChoice.parse` and `DetectorChoice.make`."""
    return DetectorChoice.parse(name).make(
        neighbours=neighbours,
        points_in_world=points_in_world,
        reference=reference,
        weights=None if weights is None else Path(weights),
    )
