"""Networks of a few nodes, written as protobuf by hand: the `onnx` package is no dependency."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

Field = tuple[int, int | bytes]
Size = int | str
FLOAT, INTS = 1, 7


def message(*fields: Field) -> bytes:
    """Protobuf: numbers as varints, everything else length-delimited."""
    parts = []
    for number, value in fields:
        if isinstance(value, int):
            parts.append(varint(number << 3) + varint(value))
        else:
            parts.append(varint(number << 3 | 2) + varint(len(value)) + value)
    return b"".join(parts)


def varint(value: int) -> bytes:
    low, rest = value & 0x7F, value >> 7
    return bytes([low]) if not rest else bytes([low | 0x80]) + varint(rest)


def tensor(name: str, channels: int, height: Size = "h", width: Size = "w") -> bytes:
    """A float32 input or output (1, channels, height, width)."""
    sizes = (1, channels, height, width)
    dims = [message((2, n.encode()) if isinstance(n, str) else (1, n)) for n in sizes]
    shape = message(*((1, dim) for dim in dims))
    return message((1, name.encode()), (2, message((1, message((1, 1), (2, shape))))))


def convolution(path: Path, kernels: Mapping[str, np.ndarray], **metadata: object) -> Path:
    """A network of the project's contract: each output is the image under kernels (K, C, h, w).

    Odd kernels, padded with nothing beyond the edge; `metadata` goes over the usual entries.
    """
    nodes, outputs, weights = [], [], []
    for name, kernel in kernels.items():
        pads = [side // 2 for side in kernel.shape[2:]] * 2
        attribute = message((1, b"pads"), *((8, n) for n in pads), (20, INTS))
        inputs = ((1, b"image"), (1, f"{name}_kernel".encode()))
        nodes.append(message(*inputs, (2, name.encode()), (4, b"Conv"), (5, attribute)))
        outputs.append(tensor(name, len(kernel)))
        raw = kernel.astype("<f4").tobytes()
        dims = [(1, int(n)) for n in kernel.shape]
        weights.append(message(*dims, (2, FLOAT), (8, f"{name}_kernel".encode()), (9, raw)))
    channels = next(iter(kernels.values())).shape[1]
    graph = message(
        *((1, node) for node in nodes),
        (2, b"g"),
        *((5, weight) for weight in weights),
        (11, tensor("image", channels)),
        *((12, output) for output in outputs),
    )
    usual = {"schema": "locate.network/1", "name": "tiny", "stride": 4, "receptive_px": 8}
    entries = {**usual, "channels": channels, **metadata}
    props = [
        message(
            (1, key.encode()),
            (2, (value if isinstance(value, str) else json.dumps(value)).encode()),
        )
        for key, value in entries.items()
        if value is not None
    ]
    content = [(7, graph), (8, message((2, 13))), *((14, prop) for prop in props)]
    path.write_bytes(message((1, 8), *content))
    return path
