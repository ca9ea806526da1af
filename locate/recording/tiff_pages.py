"""The pages of a TIFF file: where their directories stand, and one of them made the only one."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from geometry.regular_files import open_regular


@dataclass(frozen=True, kw_only=True)
class TiffPages:
    """Where the pages of a TIFF file stand.

    Attributes:
        offsets: Where the directory of each page begins, bytes.
        ends: Where it names the next one.
        place: Where the file names the first of them.
        layout: Of an offset, for `struct`.
    """

    offsets: tuple[int, ...] = ()
    ends: tuple[int, ...] = ()
    place: int = 4
    layout: str = "<I"

    def __len__(self) -> int:
        return len(self.offsets)

    @classmethod
    def of(cls, path: Path) -> Self:
        """Those of a file up to the first that is damaged or comes again; none where it is none."""
        ends: dict[int, int] = {}
        try:
            with open_regular(path) as file:
                head = file.read(16)
                order = {b"II": "<", b"MM": ">"}[head[:2]]
                (version,) = struct.unpack(order + "H", head[2:4])
                wide = version == 43  # BigTIFF
                number, entry, offset = ("Q", 20, "Q") if wide else ("H", 12, "I")
                place, layout = 8 if wide else 4, order + offset
                (position,) = struct.unpack_from(layout, head, place)
                while position and position not in ends:
                    file.seek(position)
                    (tags,) = struct.unpack(order + number, file.read(struct.calcsize(number)))
                    ends[position] = file.seek(tags * entry, 1)
                    (position,) = struct.unpack(layout, file.read(struct.calcsize(layout)))
        except (OSError, KeyError, OverflowError, struct.error):
            return cls()
        return cls(offsets=tuple(ends), ends=tuple(ends.values()), place=place, layout=layout)

    def keep_only(self, content: NDArray[np.uint8], row: int) -> None:
        """Changes the bytes of the file so that it names this page alone, and decoders follow none.

        Other pages can be kept afterwards.
        """
        for place, offset in ((self.place, self.offsets[row]), (self.ends[row], 0)):
            field = np.frombuffer(struct.pack(self.layout, offset), np.uint8)
            content[place : place + len(field)] = field
