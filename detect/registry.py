"""Which detector a name means."""

from pathlib import Path

import detect
from detect.bos import BosDetector
from detect.detection import Detector
from detect.fused import FusedDetector
from detect.registered import RegisteredDetector
from geometry.arrays import FloatArray, GreyImage
from geometry.errors import BadInputError

DETECT = Path(detect.__file__).parent
DYBS_WEIGHTS = DETECT / "dybs" / "weights" / "lite-fast.onnx"
REGISTERED_WEIGHTS = DETECT / "registered" / "weights" / "registered.onnx"
PLAIN = "registered-plain"
CLUTTER_NATS = 5.0


def make_detector(
    name: str,
    *,
    neighbours: int = 8,
    points_in_world: FloatArray | None = None,
    reference: GreyImage | None = None,
    weights: Path | None = None,
) -> Detector:
    """The detector of that name; ``a+b`` is a, helped by b.

    Args:
        name: ``registered``, ``registered-plain``, ``bos``, ``dybs``, or two of them. The first is
            learned where weights are installed, the second always judges by hand.
        neighbours: How many other frames ``registered`` compares each with.
        points_in_world: (N, 3) sparse points of the scene, for ``registered``.
        reference: The view without plume, for ``bos``.
        weights: An .onnx file for ``dybs``, or for ``registered`` alone; None takes what is
            installed.

    Raises:
        BadInputError: The weights are missing or not the network's.
    """
    first, _, second = name.partition("+")
    if second:
        helped = make_detector(
            first, neighbours=neighbours, points_in_world=points_in_world, reference=reference
        )
        return FusedDetector(helped, make_detector(second, weights=weights))
    if name == "bos":
        return BosDetector(reference=reference)
    if name == "dybs":
        return single_frame_detector(weights)
    network = None if name == PLAIN else registered_weights(weights)
    return RegisteredDetector(
        neighbours=neighbours, points_in_world=points_in_world, weights=network
    )


def single_frame_detector(weights: Path | None) -> Detector:
    """The dybs detector with these weights, or with those installed.

    Raises:
        BadInputError: There are none, or they are not the network's.
    """
    weights = found_weights(weights)
    if weights is None:
        raise BadInputError("dybs has no weights installed; give some with --weights FILE.onnx")
    from detect.dybs import DybsDetector

    return DybsDetector(weights)


def found_weights(weights: Path | None) -> Path | None:
    """Of dybs: the weights given, else those installed, else None."""
    return _given_or_installed(weights, DYBS_WEIGHTS)


def registered_weights(weights: Path | None = None) -> Path | None:
    """The network over registered neighbours: the one given, else the installed one, else None."""
    return _given_or_installed(weights, REGISTERED_WEIGHTS)


def _given_or_installed(given: Path | None, installed: Path) -> Path | None:
    if given is not None:
        return given
    return installed if installed.is_file() else None


def clutter_nats(detector: str) -> float:
    """What a column must have for every view that was summed, by the name of who saw it.

    A network is wrong alike from all sides, and chance knows nothing of that. In ten development
    scenes without a plume the strongest column had 19 nats of 16 views, in nine real recordings 61:
    80 are asked of 16.
    """
    return CLUTTER_NATS if detector.partition("+")[0] == "registered" else 0.0


def files_of(name: str, weights: Path | None) -> list[Path]:
    """The files that the detector of that name reads its weights from; see `make_detector`."""
    parts = name.split("+")
    found = {
        "dybs": found_weights(weights),
        "registered": registered_weights(weights if len(parts) == 1 else None),
    }
    return [path for part in parts if (path := found.get(part)) is not None]
