"""Networks as ONNX files, for a runtime without torch."""

import json
import logging
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
import onnx
import torch
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process
from torch import Tensor, nn

from detect.learning.checkpoint import load_weights, read_checkpoint
from detect.learning.config import TrainConfig
from detect.learning.networks import PaperUNet, PlumeNet, build_network
from detect.learning.pools import SamplePool, as_input
from detect.learning.trainer import BEST, LAST
from geometry.atomic import atomic_path
from geometry.disk_space import check_space
from geometry.errors import UnwritableError

SCHEMA = "locate.network/1"
OPSET = 20
MOST_STRIDES = 1 << 12
SPACE_TO_QUANTISE = 4
"""Bytes that onnxruntime writes on the way, over those of the network; it does not see that the
disk is full, and then reads half a file."""
SOME, CALIBRATION_SAMPLES, CALIBRATION_BATCH = 1024, 128, 8


def export_checkpoint(config: TrainConfig, checkpoint: Path, path: Path) -> Path:
    """Writes a checkpoint's network with its metadata; any multiple of its stride goes in.

    Args:
        config: It was trained with.
        checkpoint: Its weights.
        path: The .onnx file.

    Raises:
        BadInputError: The checkpoint is not readable or of another network; PATH is not writable.
    """
    content = read_checkpoint(checkpoint)
    network = build_network(config.network)
    load_weights(network, content, checkpoint)
    trained_on = {
        "config": config.weights_digest(content["step"]),
        "steps": content["step"],
        "data": config.trained_on,
    }
    return save_network(network.eval(), path, config.name, config.network.channels, trained_on)


def export_training(config: TrainConfig, folder: Path) -> list[Path]:
    """Writes best.onnx and last.onnx of a finished training; for images last-int8.onnx too.

    Args:
        config: It was trained with.
        folder: Of the training.

    Returns:
        The files.
    """
    files = [
        export_checkpoint(config, folder / name, folder / f"{name[:-3]}.onnx")
        for name in (BEST, LAST)
    ]
    if config.network.kind == "plume" and config.network.normalise:
        pool = config.pools[next(iter(config.stages[-1].pools))]
        some = SamplePool.load(
            pool.model_copy(update={"samples": pool.samples and min(pool.samples, SOME)})
        )
        files.append(quantise_network(files[-1], folder / "last-int8.onnx", some))
    return files


def write_metadata(path: Path, metadata: Mapping[str, str]) -> Path:
    """Adds entries to the metadata of an .onnx file, such as its calibration."""
    model = onnx.load(path)
    props = {entry.key: entry.value for entry in model.metadata_props}
    onnx.helper.set_model_props(model, {**props, **metadata})
    return _write_model(model, path)


def save_network(
    network: nn.Module, path: Path, name: str, channels: int, trained_on: Mapping[str, Any]
) -> Path:
    """Writes a network in evaluation mode; see `export_checkpoint`."""
    network = cast(PlumeNet | PaperUNet, network)
    image = torch.rand(2, channels, 4 * network.stride, 5 * network.stride)
    with torch.inference_mode():
        outputs = [key for key, map_ in network(image)._asdict().items() if map_ is not None]
    model = _to_onnx(_OutputMaps(network, outputs), network.stride, image, outputs)
    onnx.helper.set_model_props(
        model,
        {
            "schema": SCHEMA,
            "name": name,
            "stride": str(network.stride),
            "channels": str(channels),
            "receptive_px": str(network.receptive_px),
            "calibration": json.dumps(None),
            "trained_on": json.dumps(dict(trained_on)),
        },
    )
    return _write_model(model, path)


def quantise_network(path: Path, int8: Path, pool: SamplePool) -> Path:
    """Writes the int8 twin of an fp32 network, for masks.

    Static, calibrated on samples spread over a pool; the first and the last convolution stay in
    fp32, which costs little and saves most of the loss.

    Args:
        path: The fp32 .onnx file.
        int8: The file to write.
        pool: Training samples.

    Raises:
        UnwritableError: The file cannot be written, or files on the way to it.
    """
    try:
        with TemporaryDirectory() as workshop:
            check_space(Path(workshop), SPACE_TO_QUANTISE * path.stat().st_size)
            model = _quantised_model(path, pool, Path(workshop))
    except OSError as error:
        raise UnwritableError.of(Path(error.filename or int8), error) from error
    return _write_model(model, int8)


def _quantised_model(path: Path, pool: SamplePool, workshop: Path) -> onnx.ModelProto:
    prepared, quantised = workshop / "prepared.onnx", workshop / "quantised.onnx"
    quant_pre_process(path, prepared, skip_symbolic_shape=True)
    quantize_static(
        prepared,
        quantised,
        _CalibrationSamples(pool),
        quant_format=QuantFormat.QDQ,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        per_channel=True,
        op_types_to_quantize=["Conv", "Relu", "Add", "Resize"],
        nodes_to_exclude=_fp32_nodes(onnx.load(prepared)),
    )
    props = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    model = onnx.load(quantised)
    onnx.helper.set_model_props(model, props | {"name": f"{props['name']}-int8"})
    return model


def _fp32_nodes(model: onnx.ModelProto) -> list[str]:
    """What stays in fp32: up to the first convolution, and from the last on."""
    nodes = list(model.graph.node)
    first, *_, last = (i for i, node in enumerate(nodes) if node.op_type == "Conv")
    return [node.name for i, node in enumerate(nodes) if not first < i < last]


class _OutputMaps(nn.Module):
    """The maps that a network has, as a tuple."""

    def __init__(self, network: nn.Module, outputs: list[str]) -> None:
        super().__init__()
        self.network, self.outputs = network, outputs

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        prediction = self.network(image)
        return tuple(getattr(prediction, name) for name in self.outputs)


@dataclass
class _CalibrationSamples(CalibrationDataReader):  # type: ignore[misc]
    """Images spread over a pool, a few at a time."""

    pool: SamplePool

    def __post_init__(self) -> None:
        self._batches = self._read_batches()

    def get_next(self) -> dict[str, np.ndarray] | None:
        """The next images, None after the last."""
        return next(self._batches, None)

    def _read_batches(self) -> Iterator[dict[str, np.ndarray]]:
        chosen = np.linspace(0, len(self.pool) - 1, CALIBRATION_SAMPLES).astype(int)
        for start in range(0, len(chosen), CALIBRATION_BATCH):
            some = chosen[start : start + CALIBRATION_BATCH]
            yield {"image": as_input(self.pool.images[some])}


def _to_onnx(network: nn.Module, stride: int, image: Tensor, outputs: list[str]) -> onnx.ModelProto:
    height, width = (torch.export.Dim(name, min=1, max=MOST_STRIDES) for name in ("h", "w"))
    sizes = {0: torch.export.Dim("n", min=1), 2: stride * height, 3: stride * width}
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it misses torchvision, we do not
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch's own, about its own internals
        program = torch.onnx.export(
            network,
            (image,),
            dynamo=True,
            input_names=["image"],
            output_names=outputs,
            dynamic_shapes=(sizes,),
            opset_version=OPSET,
            verbose=False,
        )
    if program is None:
        raise RuntimeError("torch.onnx.export gave no program")
    return _without_traces(program.model_proto)


def _without_traces(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without the stack traces, and so the paths, of whoever exported it."""
    graph = model.graph
    for part in (graph, *graph.node, *graph.value_info, *graph.input, *graph.output):
        del part.metadata_props[:]
        part.doc_string = ""
    for tensor in graph.initializer:
        del tensor.metadata_props[:]
    return model


def _write_model(model: onnx.ModelProto, path: Path) -> Path:
    try:
        with atomic_path(path) as unfinished:
            unfinished.write_bytes(model.SerializeToString())
    except OSError as error:
        raise UnwritableError.of(path, error) from error
    return path
