"""Videos as FFmpeg opens them: files that hold all they show."""

from pathlib import Path

import av
from av.container import InputContainer

from geometry.errors import BadInputError
from geometry.regular_files import refuse_streams

FORMATS = (
    *("mov", "matroska", "avi", "mpegts", "mpeg", "mpegvideo", "mxf", "gxf", "asf", "flv", "ogg"),
    *("nut", "ivf", "h264", "hevc", "vvc", "av1", "obu", "m4v", "mjpeg", "dv", "wtv", "cine"),
    *("yuv4mpegpipe", "ser", "gif", "apng"),
)
"""By FFmpeg's names. Lists of other files (ffconcat, HLS, SDP) are none: what a stranger names in
them would be read, or waited for."""
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
