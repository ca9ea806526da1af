"""The stage that chooses: the key frames of a recording, as images and an index."""

from locate.journal.progress import Report
from locate.pipeline.files import RunFiles
from locate.recording import Recording, select_frames


def write_key_frames(
    recording: Recording, target: RunFiles, *, max_frames: int, report: Report
) -> str:
    """Writes the key frames of a recording and their index; returns a summary.

    Raises:
        BadInputError: Fewer than two frames, or frames that cannot be used.
    """
    key_frames = select_frames(
        recording,
        target.frames,
        max_frames=max_frames,
        progress=lambda _, share: report("frames", share),
    )
    key_frames.save(target.frame_index)
    motion = "camera at rest" if key_frames.static else "moving camera"
    return f"{len(key_frames)} of {key_frames.width}x{key_frames.height} px, {motion}"
