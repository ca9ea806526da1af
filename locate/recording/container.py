"""Videos as FFmpeg opens them: files that hold all they show."""

from pathlib import Path

import av
from av.container import InputContainer

from geometry import MOST_PIXELS
from geometry.errors import BadInputError
from geometry.regular_files import refuse_streams
from locate.recording.formats import TOO_LARGE
from locate.recording.streams import picture_stream

FORMATS = (
    *("mov", "matroska", "avi", "mpegts", "mpeg", "mpegvideo", "mxf", "gxf", "asf", "flv", "ogg"),
    *("nut", "ivf", "h264", "hevc", "vvc", "av1", "obu", "m4v", "mjpeg", "dv", "wtv", "cine"),
    *("yuv4mpegpipe", "ser", "gif", "apng"),
)
"""By FFmpeg's names. Lists of other files (ffconcat, HLS, SDP) are none: what a stranger names in
them would be read, or waited for."""
UNREADABLE = (OSError, ValueError, av.error.FFmpegError)  # some of av's errors are neither
OPTIONS = {"format_whitelist": ",".join(FORMATS), "protocol_whitelist": "file"}


def open_container(path: Path) -> InputContainer:
    """Opens a video file, whatever streams it has.

    Raises:
        BadInputError: It is a pipe or a device, or of no format that is read.
        OSError, ValueError, FFmpegError: It cannot be opened.
    """
    refuse_streams(path)
    try:
        return av.open(str(path.absolute()), options=OPTIONS)  # 12:30:05.mkv is no protocol
    except av.error.ArgumentError as error:
        raise BadInputError(
            f"{path}: a list of other files, or no video format that is read; "
            "give a video such as .mp4, .mov or .mkv"
        ) from error


def open_video(path: Path) -> "av.container.InputContainer":
    """Opens a file that has a video stream.

    Raises:
        BadInputError: It cannot be read, or has none.
    """
    try:
        container = open_container(path)
    except UNREADABLE as error:
        raise BadInputError(f"{path}: not a readable video ({_error_text(error)})") from error
    if not container.streams.video:
        container.close()
        raise BadInputError(f"{path}: holds no video stream")
    stream = picture_stream(container)
    if stream.codec_context is None:
        container.close()
        raise BadInputError(f"{path}: its video stream is of no codec that can be decoded")
    if stream.width * stream.height > MOST_PIXELS:
        container.close()
        raise BadInputError(f"{path}: its frames are {TOO_LARGE}")
    return container


def start_of_video_s(container: "av.container.InputContainer") -> float:
    """When the first frame is shown, s on the clock that all streams of the file share."""
    if not container.streams.video:
        return 0.0
    stream = picture_stream(container)
    if stream.start_time is None or stream.time_base is None:
        return 0.0
    return float(stream.start_time * stream.time_base)


def _error_text(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
