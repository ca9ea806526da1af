"""Which of the video streams of a file is the recording."""

import av
from av.stream import Disposition


def picture_stream(container: "av.container.InputContainer") -> "av.VideoStream":
    """The largest that is no cover picture, of equal ones the first, of a file that has some."""
    streams = container.streams.video
    pictures = [stream for stream in streams if not _is_cover(stream)]
    return max(pictures or streams, key=_pixels)


def describe_other_streams(container: "av.container.InputContainer") -> list[str]:
    """A note on further video streams, of a second lens or a smaller copy, where there are any."""
    chosen = picture_stream(container)
    videos = [stream for stream in container.streams.video if _pixels(stream)]
    others = [stream for stream in videos if stream is not chosen and not _is_cover(stream)]
    if not others:
        return []
    sizes = ", ".join(f"{stream.width}x{stream.height}" for stream in others)
    return [
        f"holds {len(others) + 1} video streams; that of {chosen.width}x{chosen.height} is used, "
        f"and {sizes} left out: ffmpeg -map 0:v:1 writes the second as a file"
    ]


def _is_cover(stream: "av.VideoStream") -> bool:
    return bool(stream.disposition & Disposition.attached_pic)


def _pixels(stream: "av.VideoStream") -> int:
    """Of a frame; 0 where no codec states it."""
    return 0 if stream.codec_context is None else stream.width * stream.height
