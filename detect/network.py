"""Networks in ONNX files: opened, checked, and run on images of any size."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from geometry.arrays import FloatMap
from geometry.errors import BadInputError
from geometry.json_text import parse_json

SCHEMA = "locate.network/1"
PROVIDERS = ("CUDAExecutionProvider", "CPUExecutionProvider")
QUIET = 4
MOST_PADDING_PX = 4096
"""Of an image on account of a file's stride or receptive field; real ones ask for tens."""
LARGEST_PX = 2_000_000
"""Above this many pixels an image is run in tiles; a pixel costs some 300 bytes."""

Maps = Mapping[str, FloatMap]
TileSlices = tuple[tuple[slice, slice], tuple[slice, slice], tuple[slice, slice]]


def open_session(path: Path, what: str = "network") -> Any:
    """An onnxruntime session of one thread, on CUDA where the installed onnxruntime has it.

    Args:
        path: The .onnx file.
        what: It should be, for the message.

    Raises:
        BadInputError: The file is missing or is not ONNX.
    """
    if not path.is_file():
        raise BadInputError(f"{path}: no such {what}; give the path of an .onnx file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = QUIET
    available = onnxruntime.get_available_providers()
    providers = [provider for provider in PROVIDERS if provider in available]
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers)
    except Exception as error:  # onnxruntime's errors share no base of their own
        raise BadInputError(f"{path}: not a readable ONNX network") from error


class Network:
    """A network that the project exported: one input, any number of named maps as outputs.

    The file's contract, schema `locate.network/1`: one float32 input (N, C, H, W), H and W free
    multiples of `stride`; outputs (N, K, H, W) float32. Its metadata hold `schema`, `name`,
    `stride`, `channels` and `receptive_px`.

    Args:
        path: The .onnx file.
        largest_px: Images of more pixels are run in tiles, with the same result.

    Attributes:
        name: As stored in the file.
        channels: C.
        stride: What H and W are padded to.
        receptive_px: How far from a pixel the image can change its output.
        outputs: Names of its outputs.
        metadata: All that is stored in the file.

    Raises:
        BadInputError: The file is missing, is not ONNX, or breaks the contract.
    """

    def __init__(self, path: Path, *, largest_px: int = LARGEST_PX) -> None:
        self.path = path
        self._session = open_session(path)
        self._largest_px = largest_px
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        if self.metadata.get("schema") != SCHEMA:
            raise BadInputError(f"{path}: its metadata lack schema {SCHEMA}; export it anew")
        try:
            self.name = self.metadata["name"]
            sizes = [int(self.metadata[key]) for key in ("stride", "channels", "receptive_px")]
        except (KeyError, ValueError) as error:
            raise BadInputError(f"{path}: incomplete metadata ({error}); export it anew") from error
        self.stride, self.channels, self.receptive_px = sizes
        inputs = self._session.get_inputs()
        shape = inputs[0].shape if len(inputs) == 1 else None
        if not 1 <= self.stride <= MOST_PADDING_PX or not 0 <= self.receptive_px <= MOST_PADDING_PX:
            raise BadInputError(
                f"{path}: stride {self.stride} and receptive_px {self.receptive_px} are not "
                f"between 1 and {MOST_PADDING_PX} px; export it anew"
            )
        if not shape or len(shape) != 4 or shape[1] != self.channels:
            raise BadInputError(
                f"{path}: expected one input (N, {self.channels}, H, W), found "
                f"{[node.shape for node in inputs]}"
            )
        self._input = inputs[0].name
        self.outputs = [node.name for node in self._session.get_outputs()]

    def read_metadata(self, key: str) -> Any:
        """A metadata entry, decoded; None where the file has no such entry.

        Raises:
            BadInputError: It is not JSON.
        """
        try:
            return parse_json(self.metadata.get(key, "null"))
        except ValueError as error:
            raise BadInputError(
                f"{self.path}: metadata {key!r} is broken; export it anew"
            ) from error

    def __call__(self, planes: FloatMap) -> Maps:
        """Runs the network on one image.

        Args:
            planes: (C, H, W) float32, of any size.

        Returns:
            Its outputs by name, each (K, H, W) float32.

        Raises:
            BadInputError: The channels are not the network's, or it fails.
        """
        if planes.ndim != 3 or planes.shape[0] != self.channels or not planes.size:
            raise BadInputError(f"{self.path}: {planes.shape=}, expected ({self.channels}, H, W)")
        height, width = planes.shape[1:]
        padding = [(0, 0), *((0, -side % self.stride) for side in (height, width))]
        padded = np.asarray(planes, np.float32)
        if np.any(padding):
            padded = np.pad(padded, padding, mode="reflect")
        run = self._run_whole if padded[0].size <= self._largest_px else self._run_tiled
        maps = run(padded)
        return {name: found[:, :height, :width] for name, found in maps.items()}

    def _run_whole(self, planes: FloatMap) -> dict[str, FloatMap]:
        try:
            found = self._session.run(self.outputs, {self._input: planes[None]})
        except Exception as error:  # onnxruntime's errors share no base of their own
            raise BadInputError(f"{self.path}: the network failed on {planes.shape=}") from error
        for name, array in zip(self.outputs, found, strict=True):
            if array.ndim != 4 or array.shape[2:] != planes.shape[1:]:
                raise BadInputError(f"{self.path}: output {name} {array.shape}, {planes.shape=}")
        return {name: array[0] for name, array in zip(self.outputs, found, strict=True)}

    def _run_tiled(self, planes: FloatMap) -> dict[str, FloatMap]:
        maps: dict[str, FloatMap] = {}
        for seen, kept, target in self._cut_tiles(planes.shape[1:]):
            for name, part in self._run_whole(planes[(slice(None), *seen)]).items():
                if name not in maps:
                    maps[name] = np.empty((len(part), *planes.shape[1:]), np.float32)
                maps[name][(slice(None), *target)] = part[(slice(None), *kept)]
        return maps

    def _cut_tiles(self, shape: tuple[int, ...]) -> Iterator[TileSlices]:
        """What to show the network, what of its answer to keep, and where that belongs."""
        margin = -(-self.receptive_px // self.stride) * self.stride
        side = int(np.sqrt(self._largest_px)) // self.stride * self.stride
        step = max(side - 2 * margin, self.stride)
        for top in range(0, shape[0], step):
            for left in range(0, shape[1], step):
                spans = [
                    _tile_span(at, step, margin, n)
                    for at, n in zip((top, left), shape, strict=True)
                ]
                seen, kept, target = zip(*spans, strict=True)
                yield seen, kept, target


def _tile_span(start: int, step: int, margin: int, length: int) -> tuple[slice, slice, slice]:
    """Of one axis: the part seen, the part of it that is kept, and where that belongs."""
    stop = min(start + step, length)
    first = max(start - margin, 0)
    seen = slice(first, min(stop + margin, length))
    return seen, slice(start - first, stop - first), slice(start, stop)
