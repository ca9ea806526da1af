"""The images of a bag: on one scale of grey, on one clock, with the reasons for those left out."""

from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from geometry.stretch import Stretch
from locate.messages.bags import BagTopics, TopicChoice, open_bag
from locate.messages.codec import GreyReader, read_samples, read_stamp_ns
from locate.messages.stamps import NS_PER_S
from locate.recording.depth import SAMPLED
from locate.recording.video import NamedImage


class BagImages:
    """The images of one topic, read as often as asked; a frame's name is its stamp in ns.

    Args:
        path: The bag.
        topics: Those chosen.
    """

    def __init__(self, path: Path, topics: TopicChoice) -> None:
        self._path = path
        self._topics = topics

    @cached_property
    def stretch(self) -> Stretch | None:
        """How samples of 16 bits are shown; None where all images that were looked at have 8."""
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            return Stretch.choose(_deep_samples(topics.sample_messages(topics.image, SAMPLED)))

    @cached_property
    def has_stamps(self) -> bool:
        """Whether the first images are stamped; False where the stamps do not tell them apart."""
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            messages = topics.read_messages([topics.image], lambda *_: None)
            stamps = [read_stamp_ns(m.header) for _, _, m in islice(messages, SAMPLED)]
        return 2 * len(set(stamps)) > len(stamps) or len(stamps) < 2

    def stamp_ns(self, message: Any, time_ns: int) -> int:
        """When an image was taken, ns; when it was recorded, where the images are not stamped."""
        return read_stamp_ns(message.header) if self.has_stamps else time_ns

    def read_first(self) -> GreyImage:
        """The first image that can be read.

        Raises:
            BadInputError: None can, with the reason.
        """
        notes: list[str] = []
        for _, _, image in self.read(notes):
            return image
        reason = notes[0] if notes else f"{self._path.name}: its topic of images is empty"
        raise BadInputError(f"{self._path}: not one image of this bag can be read: {reason}")

    def read(self, warnings: list[str]) -> Iterator[NamedImage]:
        """Time from the first (s), name and image; what cannot be read is noted in `warnings`."""
        grey = GreyReader(self.stretch)
        left_out: Counter[str] = Counter()
        start_ns: int | None = None
        read = 0
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            for _, time_ns, message in topics.read_messages(
                [topics.image], lambda _, error: left_out.update([str(error)])
            ):
                try:
                    image = grey.read(message)
                except BadInputError as error:
                    left_out[str(error)] += 1
                    continue
                read += 1
                stamp = self.stamp_ns(message, time_ns)
                start_ns = stamp if start_ns is None else start_ns
                yield (stamp - start_ns) / NS_PER_S, str(stamp), image
        self._add_notes(warnings, left_out, read)

    def _add_notes(self, warnings: list[str], left_out: Counter[str], read: int) -> None:
        name, count = self._path.name, read + left_out.total()
        notes = [
            f"{name}: {times} of {count} images cannot be read: {reason}"
            for reason, times in left_out.most_common()
        ]
        if count and not self.has_stamps:
            notes.append(
                f"{name}: the stamps of the images do not tell them apart (all zero, or one for "
                "many): the times at which they were recorded are taken"
            )
        warnings += [note for note in notes if note not in warnings]


def _deep_samples(messages: Iterator[Any]) -> Iterator[NDArray[np.uint16]]:
    for message in messages:
        try:
            samples = read_samples(message)
        except BadInputError:
            continue  # counted when it is read as a frame
        if samples.dtype == np.uint16:
            yield samples.astype(np.uint16, copy=False)
