"""The stage that chooses: the key frames of a recording, as images and an index."""

from geometry.reports import Report
from locate.pipeline.files import RunFiles
from locate.recording import Recording, select_frames


def write_key_frames(
    recording: Recording,
    target: RunFiles,
    *,
    max_frames: int,
    at_rest: bool,
    shot: int | None,
    report: Report,
) -> str:
    """Writes the key frames of a recording and their index; returns a summary.

    Args:
        recording: The frames.
        target: Where to write.
        max_frames: The most frames to keep.
        at_rest: The camera is known to have been at rest.
        shot: Of a video, the one to use, from 1; None for the longest.
        report: Takes the progress.

    Raises:
        BadInputError: Fewer than two frames, or frames that cannot be used.
    """
    key_frames = select_frames(
        recording,
        target.frames,
        max_frames=max_frames,
        at_rest=at_rest,
        shot=shot,
        progress=lambda _, share: report("frames", share),
    )
    key_frames.save(target.frame_index)
    motion = "camera at rest" if key_frames.static else "moving camera"
    size = f"{key_frames.width}x{key_frames.height} px"
    full = key_frames.full_size
    at_full_size = "" if full is None else f", all pixels at {full[0]}x{full[1]} px"
    return f"{len(key_frames)} of {size}{at_full_size}, {motion}"
