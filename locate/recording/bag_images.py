"""The images of a bag: on one scale of grey, on one clock, with the reasons for those left out."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import GreyImage, GreySamples
from geometry.errors import BadInputError
from geometry.stretch import DeepSamples, Stretch, deep_samples
from locate.messages.bags import BagTopics, TopicChoice, open_bag
from locate.messages.codec import decode_message, header_of, read_stamp_ns
from locate.messages.image_stream import ImageStream, StampedImage, decoder_of
from locate.messages.stamps import NS_PER_S
from locate.recording.depth import SAMPLED
from locate.recording.video import LeftOutError, NamedImage, find_gaps

NO_PICTURE = "coded video without a key frame before it, or damaged since the last one"
"""Why messages of coded video give no picture."""
GAP = 1.75
"""Time between two messages, over the usual one, from which on some may be missing; chosen."""


class BagImages:
    """The images of one topic, which can be read more than once; a frame's name is its stamp in ns.

    Args:
        path: The bag.
        topics: Those chosen.
    """

    def __init__(self, path: Path, topics: TopicChoice) -> None:
        self._path = path
        self._topics = topics

    @cached_property
    def stretch(self) -> Stretch | None:
        """How deep samples are shown; None where all images that were looked at have 8 bits."""
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            return Stretch.choose(_deep_samples(topics.sample_messages(topics.image, SAMPLED)))

    @cached_property
    def has_stamps(self) -> bool:
        """Whether the first images are stamped; False where the stamps do not tell them apart."""
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            messages = topics.read_messages([topics.image], lambda *_: None)
            stamps = [read_stamp_ns(header_of(m)) for _, _, m in islice(messages, SAMPLED)]
        return 2 * len(set(stamps)) > len(stamps) or len(stamps) < 2

    def stamp_ns(self, message: Any, time_ns: int) -> int:
        """When an image was taken, ns; when it was recorded, where the images are not stamped."""
        return read_stamp_ns(header_of(message)) if self.has_stamps else time_ns

    def read_first(self) -> GreySamples:
        """The first image that can be read.

        Raises:
            BadInputError: None can, with the reason.
        """
        notes: list[str] = []
        for image in self.read(notes):
            with suppress(LeftOutError):
                return image.load()
        reason = notes[0] if notes else f"{self._path.name}: its topic of images is empty"
        raise BadInputError(f"{self._path}: not one image of this bag can be read: {reason}")

    def read(self, warnings: list[str]) -> Iterator[NamedImage]:
        """Time from the first (s), name and image; what cannot be read is noted in `warnings`."""
        left_out: Counter[str] = Counter()
        stamps: list[int] = []

        def load(read: Callable[[], GreyImage]) -> GreyImage:
            try:
                return read()
            except BadInputError as error:
                left_out[str(error)] += 1
                del stamps[-1]
                raise LeftOutError from error

        for stamp, read in self._read_stamped(left_out):
            stamps.append(stamp)
            time_s = (stamp - stamps[0]) / NS_PER_S
            yield NamedImage(time_s, str(stamp), partial(load, read))
        self._add_notes(warnings, left_out, stamps)

    def _read_stamped(
        self, left_out: Counter[str]
    ) -> Iterator[tuple[int, Callable[[], GreyImage]]]:
        """Stamps (ns), and what gives the image; coded video is decoded as it comes."""
        stream = ImageStream(self.stretch)
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            for _, time_ns, message in topics.read_messages(
                [topics.image], lambda _, error: left_out.update([str(error)])
            ):
                stamp = self.stamp_ns(message, time_ns)
                if decoder_of(message) is None:
                    yield stamp, partial(_read_picture, stream, message)
                    continue
                try:
                    yield from _decoded(stream.read(message, stamp))
                except BadInputError as error:
                    left_out[str(error)] += 1
        yield from _decoded(stream.finish())
        if stream.pictureless:
            left_out[NO_PICTURE] += stream.pictureless

    def _add_notes(self, warnings: list[str], left_out: Counter[str], stamps: list[int]) -> None:
        name, count = self._path.name, len(stamps) + left_out.total()
        notes = [
            f"{name}: {times} of {count} images cannot be read: {reason}"
            for reason, times in left_out.most_common()
        ]
        if count and not self.has_stamps:
            notes.append(
                f"{name}: the stamps of the images do not tell them apart (all zero, or one for "
                "many): the times at which they were recorded are taken"
            )
        gaps = len(find_gaps(stamps, GAP)) if self._is_coded else 0
        if gaps:
            notes.append(
                f"{name}: {gaps} gaps between the messages of its coded video: where some were "
                "lost, pictures are wrong up to the next key frame; look at the frames"
            )
        warnings += [note for note in notes if note not in warnings]

    @cached_property
    def _is_coded(self) -> bool:
        with open_bag(self._path) as reader:
            topics = BagTopics(reader, self._path, self._topics, whole=False)
            messages = topics.sample_messages(topics.image, 1)
            return any(decoder_of(message) is not None for message in messages)


def _read_picture(stream: ImageStream, message: Any) -> GreyImage:
    (picture,) = stream.read(message, 0)
    return picture.image


def _decoded(images: Iterable[StampedImage]) -> Iterator[tuple[int, Callable[[], GreyImage]]]:
    return ((stamp, partial(np.asarray, image)) for stamp, image in images)


def _deep_samples(messages: Iterator[Any]) -> Iterator[DeepSamples]:
    for message in messages:
        if decoder_of(message) is not None:
            return
        try:
            samples = deep_samples(decode_message(message))
        except BadInputError:
            continue  # counted when it is read as a frame
        if samples is not None:
            yield samples
