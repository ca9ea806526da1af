"""COLMAP models from strangers.

COLMAP's own reader trusts every count of a binary file: one cut short makes it spin for hours or
take all memory, so the records are counted through here first. Nor does it read texts that begin
with a byte order mark, which is taken out here.
"""

import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pycolmap

from geometry.errors import BadInputError
from geometry.regular_files import read_content, refuse_streams_within
from geometry.text_files import has_mark, read_text


class _Records:
    """A file that is walked through record by record; raises ValueError at its end."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0

    def skip(self, count: int) -> None:
        self._at += count
        if self._at > len(self._content):
            raise ValueError("cut short")

    def take(self, layout: str) -> int:
        start = self._at
        self.skip(struct.calcsize(layout))
        number: int = struct.unpack_from(layout, self._content, start)[0]
        return number

    def skip_text(self) -> None:
        end = self._content.find(b"\0", self._at)
        self.skip(len(self._content) + 1 if end < 0 else end + 1 - self._at)


def _skip_camera(records: _Records) -> None:
    records.skip(4)
    model = pycolmap.CameraModelId(records.take("<i"))
    records.skip(16)
    records.skip(8 * len(pycolmap.Camera.create_from_model_id(1, model, 1.0, 2, 2).params))


def _skip_rig(records: _Records) -> None:
    records.skip(4)
    sensors = records.take("<I")
    records.skip(8 * min(sensors, 1))
    for _ in range(sensors - 1):
        records.skip(8)
        records.skip(56 if records.take("<B") else 0)


def _skip_frame(records: _Records) -> None:
    records.skip(64)
    records.skip(16 * records.take("<I"))


def _skip_image(records: _Records) -> None:
    records.skip(64)
    records.skip_text()
    records.skip(24 * records.take("<Q"))


def _skip_point(records: _Records) -> None:
    records.skip(43)
    records.skip(8 * records.take("<Q"))


FILES: dict[str, Callable[[_Records], None]] = {
    "rigs.bin": _skip_rig,
    "cameras.bin": _skip_camera,
    "frames.bin": _skip_frame,
    "images.bin": _skip_image,
    "points3D.bin": _skip_point,
}


def read_colmap_model(folder: Path) -> pycolmap.Reconstruction:
    """Reads a model, binary or as text.

    Raises:
        BadInputError: A file is missing, cannot be read, or holds other than it declares.
    """
    check_colmap_files(folder)
    texts = [] if (folder / "cameras.bin").exists() else sorted(folder.glob("*.txt"))
    try:
        if not any(map(has_mark, texts)):
            return pycolmap.Reconstruction(folder)
        with TemporaryDirectory() as plain:
            for path in texts:
                Path(plain, path.name).write_text(read_text(path), encoding="utf-8")
            return pycolmap.Reconstruction(plain)
    except (ValueError, RuntimeError, LookupError, MemoryError, OSError) as error:
        raise BadInputError(f"{folder}: not a whole COLMAP model; export it again") from error


def check_colmap_files(folder: Path) -> None:
    """Refuses pipes in a model, and a binary one in which a file holds other than it declares.

    Raises:
        BadInputError: One does, or cannot be read.
    """
    refuse_streams_within(folder)
    for name, skip_record in FILES.items():
        path = folder / name
        if not path.exists():
            continue
        try:
            content = read_content(path)
            _walk(content, skip_record)
        except OSError as error:
            raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
        except ValueError as error:
            why = " ".join(str(error).split())
            raise BadInputError(
                f"{path}: not a whole file of a COLMAP model ({why}); export the model again"
            ) from error


def _walk(content: bytes, skip_record: Callable[[_Records], None]) -> None:
    records = _Records(content)
    for _ in range(records.take("<Q")):
        skip_record(records)
    try:
        records.skip(1)
    except ValueError:
        return
    raise ValueError("longer than it declares")
