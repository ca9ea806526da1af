"""A TIFF file of several pages, read as a video."""

from collections import Counter
from collections.abc import Iterator
from functools import cached_property, partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry.arrays import GreySamples
from geometry.errors import BadInputError
from geometry.stretch import Samples, Stretch, as_samples, deep_samples
from locate.recording.decoders import reason_of
from locate.recording.depth import SAMPLED
from locate.recording.images import show_in_grey
from locate.recording.spacing import spread_rows
from locate.recording.tiff_pages import TiffPages
from locate.recording.video import LeftOutError, NamedImage

PAGE_RATE = 25.0
"""Pages a second: TIFF states no times."""
MOST_BYTES = 2**31 - 1
"""Largest file: OpenCV counts bytes in 32 bits."""


class TiffStack:
    """The pages of a TIFF file; they can be read more than once.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pages = TiffPages.of(path)
        self.count = len(self._pages)

    @cached_property
    def stretch(self) -> Stretch | None:
        """How deep pages are shown; None where all that were looked at have 8 bits."""
        rows = spread_rows(self.count, SAMPLED).tolist()
        pages = (deep_samples(self._read_page(row)) for row in rows)
        return Stretch.choose(page for page in pages if page is not None)

    def read(self, warnings: list[str]) -> Iterator[NamedImage]:
        """Time, name and image of every page; those of another size than the first are left out.

        A page that cannot be read is refused when its image is loaded.
        """
        others: Counter[str] = Counter()
        for row in range(self.count):
            load = partial(self._load_page, row, others)
            yield NamedImage(row / PAGE_RATE, self._path.name, load)
        notes = [
            f"{self._path.name}: its {self.count} pages are read as a video of {PAGE_RATE:g} "
            "frames a second, as TIFF states no times",
            *(f"{self._path.name}: {n} pages of {name} px left out" for name, n in others.items()),
        ]
        warnings += [note for note in notes if note not in warnings]

    def _load_page(self, row: int, others: Counter[str]) -> GreySamples:
        samples = self._read_page(row)
        if samples.shape != self._shape:
            others[f"{samples.shape[1]}x{samples.shape[0]}"] += 1
            raise LeftOutError
        return show_in_grey(samples, self.stretch)

    @cached_property
    def _shape(self) -> tuple[int, ...]:
        return self._read_page(0).shape

    @cached_property
    def _content(self) -> NDArray[np.uint8]:
        """Mapped, so that only what is decoded takes memory; changes are never written."""
        try:
            content = np.memmap(self._path, dtype=np.uint8, mode="c")
        except OSError as error:
            raise BadInputError(f"{self._path}: cannot be read ({error.strerror})") from error
        if len(content) > MOST_BYTES:
            raise BadInputError(f"{self._path}: a TIFF over 2 GiB is not read; split it")
        return content

    def _read_page(self, row: int) -> Samples:
        self._pages.keep_only(self._content, row)
        flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE
        try:
            page = cv2.imdecode(self._content, flags)
        except cv2.error as error:
            raise BadInputError(f"{self._path}: page {row + 1}: {reason_of(error)}") from error
        if page is None:
            raise BadInputError(f"{self._path}: page {row + 1} of {self.count} cannot be read")
        return as_samples(np.asarray(page))
