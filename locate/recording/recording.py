"""A recording: a video or photos, read frame by frame at the working size."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import GreyImage, GreySamples
from geometry.errors import BadInputError
from geometry.stretch import FINE, VALUES, Stretch, in_8_bits
from locate.recording.focal import FocalPrior
from locate.recording.images import read_samples, show_in_grey
from locate.recording.index import KeyFrame
from locate.recording.motion import measure_sharpness
from locate.recording.sizes import FrameSizes
from locate.recording.video import (
    LeftOutError,
    NamedImage,
    VideoCoding,
    chosen_video_images,
    read_coding,
    video_images,
)

Wanted = Callable[[int, NamedImage], bool]


def every_frame(index: int, image: NamedImage) -> bool:  # noqa: ARG001 - as of `Wanted`
    """All are wanted."""
    return True


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One decoded frame.

    Attributes:
        index: In the recording.
        time_s: From its start.
        source: Name of the file.
        image: (H, W) uint8 at the working size.
        samples: (H', W') at the recording's own size, as deep as they are.
        is_b_frame: Whether a codec made it of frames before and after it.
    """

    index: int
    time_s: float
    source: str
    image: GreyImage
    samples: GreySamples
    is_b_frame: bool = False


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A video or photos; `frames` reads it from the start each time.

    Attributes:
        path: The video, the folder or the photo.
        photos: The photos in natural order; empty for a video.
        sizes: Of the images.
        focal: Focal length from metadata, or None.
        expected_frames: By its header, or the photos of the folder; 0 where that is unknown.
        stretch: How samples of more than 8 bits are shown in 8; None where they need no stretch.
        warnings: Filled while reading: what is wrong without making the recording useless.
        photo_indices: Of each photo among all that were given; empty where all are used.
        turns: Quarter turns counterclockwise of some of the photos, by their place among `photos`.
        read: Yields time, name and image of each frame, for what is neither a video file nor
            photos; adds to the warnings that it is given.
    """

    path: Path
    photos: tuple[Path, ...]
    sizes: FrameSizes
    focal: FocalPrior | None
    expected_frames: int = 0
    stretch: Stretch | None = None
    warnings: list[str] = field(default_factory=list)
    photo_indices: tuple[int, ...] = ()
    turns: Mapping[int, int] = field(default_factory=dict)
    read: Callable[[list[str]], Iterator[NamedImage]] | None = None

    @property
    def is_video(self) -> bool:
        """False for photos."""
        return not self.photos

    @property
    def is_video_file(self) -> bool:
        """Whether FFmpeg reads it; False for photos, stacks of pages and bags."""
        return self.is_video and self.read is None

    @property
    def width(self) -> int:
        """Working width, px."""
        return self.sizes.working[0]

    @property
    def height(self) -> int:
        """Working height, px."""
        return self.sizes.working[1]

    @property
    def focal_prior_px(self) -> float | None:
        """Focal length from metadata, px at the working size."""
        return None if self.focal is None else self.focal.relative * max(self.width, self.height)

    @cached_property
    def coding(self) -> VideoCoding | None:
        """How a video file is coded; None for others."""
        return read_coding(self.path) if self.is_video_file else None

    @property
    def bits_per_pixel(self) -> float | None:
        """What a video file spends on each pixel at the working size.

        None for others, and for codecs that lose nothing.
        """
        if self.coding is None or not self.coding.loses:
            return None
        return self.coding.bits_per_frame / (self.width * self.height)

    def full_size(self, frame: Frame) -> GreySamples:
        """The (H', W') samples of a frame at full size; nothing is rounded to 8 bits."""
        samples, size = frame.samples, self.sizes.full
        if samples.shape == size[::-1]:
            return samples
        levels = samples.astype(np.float32)
        steps = levels * FINE if samples.dtype == np.uint8 else levels
        reduced = cv2.resize(steps, size, interpolation=cv2.INTER_AREA)
        return np.asarray(np.rint(reduced).clip(0, VALUES - 1), dtype=np.uint16)

    def frames(self, is_wanted: Wanted = every_frame) -> Iterator[Frame]:
        """Yields the frames in order; one frame is in memory at a time.

        Args:
            is_wanted: Takes the index of a frame and what it comes from. Frames that are not wanted
                are decoded only where later ones depend on them, as in coded video.

        Raises:
            BadInputError: A photo cannot be read, or the frames change in size.
        """
        for index, source in enumerate(self._source_images()):
            place = self.photo_indices[index] if self.photo_indices else index
            if not is_wanted(place, source):
                continue
            try:
                yield self._frame(place, source, self.turns.get(index, 0))
            except LeftOutError:
                continue

    def frames_again(self, chosen: Sequence[KeyFrame]) -> Iterator[Frame]:
        """Yields frames that were read before, in order, where it can without decoding all.

        Args:
            chosen: What is known of them.

        Raises:
            BadInputError: As `frames`.
        """
        count = 0
        if self.is_video_file:
            times_s = [frame.time_s for frame in chosen]
            images = chosen_video_images(self.path, times_s, self.stretch)
            for key, source in zip(chosen, images, strict=False):
                frame = self._frame(key.index, source)
                if measure_sharpness(frame.image) != key.sharpness:
                    break  # not what it was: the file says that it stands alone, and it does not
                yield frame
                count += 1
        left = {frame.index for frame in chosen[count:]}
        if left:
            yield from islice(self.frames(lambda index, _: index in left), len(left))

    def _frame(self, place: int, source: NamedImage, quarters: int = 0) -> Frame:
        """A frame of an image that is turned by so many quarters."""
        image = turn_image(source.load(), quarters)
        if image.shape[::-1] != self.sizes.source:
            height, width = image.shape
            raise BadInputError(
                f"{self.path}: frame {place} ({source.name}) is {width}x{height}, the first is "
                f"{self.sizes.source[0]}x{self.sizes.source[1]}; give frames of one camera "
                "and one size"
            )
        return Frame(
            index=place,
            time_s=float(place) if self.photo_indices else source.time_s,
            source=source.name,
            image=self._at_working_size(in_8_bits(image)),
            samples=image,
            is_b_frame=source.is_b_frame,
        )

    def _source_images(self) -> Iterator[NamedImage]:
        if self.read is not None:
            return self.read(self.warnings)
        return (
            video_images(self.path, self.warnings, self.stretch)
            if self.is_video
            else photo_images(self.photos, self.warnings, self.stretch)
        )

    def _at_working_size(self, image: GreyImage) -> GreyImage:
        size = self.sizes.working
        if image.shape == size[::-1]:
            return image
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def turn_image(image: GreySamples, quarters: int) -> GreySamples:
    """The image turned counterclockwise by so many quarter turns."""
    for _ in range(quarters % 4):
        image = image.swapaxes(0, 1)[::-1]
    return image.copy(order="C") if quarters % 4 else image


def photo_images(
    paths: tuple[Path, ...], warnings: list[str], stretch: Stretch | None
) -> Iterator[NamedImage]:
    """Time, name and image of photos; differing bit depths are noted in `warnings` at the end.

    A photo that cannot be read is refused when its image is loaded.
    """
    read: list[bool] = []

    def load(path: Path) -> GreySamples:
        samples = read_samples(path)
        read.append(samples.dtype != np.uint8 if stretch is None else not stretch.suits(samples))
        return show_in_grey(samples, stretch)

    for index, path in enumerate(paths):
        yield NamedImage(float(index), path.name, partial(load, path))
    others = sum(read)
    if others and len(read) == len(paths):
        note = (
            f"{others} of {len(paths)} photos have {'more than ' if stretch is None else ''}8 bits "
            "a sample and the others not: their greys are not alike; save all with one depth"
        )
        if note not in warnings:
            warnings.append(note)
