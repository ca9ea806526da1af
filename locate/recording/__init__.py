"""From a video or a folder of photos to the key frames that a run works on."""

from locate.recording.index import FRAMES_SCHEMA, KeyFrame, KeyFrames
from locate.recording.keyframes import select_frames
from locate.recording.opening import open_recording
from locate.recording.recording import Frame, Recording

__all__ = [
    "FRAMES_SCHEMA",
    "Frame",
    "KeyFrame",
    "KeyFrames",
    "Recording",
    "open_recording",
    "select_frames",
]
