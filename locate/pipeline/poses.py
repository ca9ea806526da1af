"""The stage that registers: a pose for every key frame, reconstructed or given."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geometry.camera import Camera
from geometry.disk_space import check_space
from geometry.errors import BadInputError
from geometry.named_poses import NamedPoses
from geometry.processes import ProcessesAhead, call_apart
from geometry.removal import remove_inside
from geometry.reports import Report
from geometry.sfm import Reconstruction, reconstruct
from geometry.sfm.given_poses import check_given_poses
from geometry.stray_poses import stray_rows
from geometry.text_files import read_json
from geometry.trajectory import Trajectory
from locate.pipeline.files import RunFiles
from locate.pipeline.source import RecordingSource
from locate.recording import KeyFrames
from locate.recording.images import FrameImages
from locate.recording.posed_frames import PosedFrames

GUESSED_FOCAL = 1.2
"""Focal length of a camera at rest of which nothing is known, in longer sides of the image."""
MOVING_SHARE = 0.02
"""An image that moves by more than this share of its width is no camera at rest."""
UNSURE_FOCAL = 0.01
"""Standard deviation of an estimated focal length over it, from which on the map says so: 0.001 on
arcs, 0.02 where the camera only came nearer and the focal length was 6 % off."""
SFM_BYTES_PER_FRAME = 1_000_000
"""Disk space that structure from motion takes for a frame, at most."""
NAME = "structure from motion"


def expect_reconstruction(ahead: ProcessesAhead) -> None:
    """Starts the process in which `reconstruct_poses` works, while the frames are chosen."""
    ahead.expect(reconstruct, name=NAME)


def reconstruct_poses(
    source: RecordingSource,
    key_frames: KeyFrames,
    files: RunFiles,
    target: RunFiles,
    report: Report,
    jobs: int = 1,
    ahead: ProcessesAhead | None = None,
) -> str:
    """Runs structure from motion on the key frames; returns a summary.

    It runs in a process of its own: COLMAP ends its process where the disk fills up meanwhile.

    Args:
        source: What is known of the camera.
        key_frames: The frames.
        files: Where their images are.
        target: Where to write.
        report: Takes the progress.
        jobs: Threads that work side by side; the result does not depend on it.
        ahead: Processes that `expect_reconstruction` started.

    Raises:
        RegistrationError: The frames could not be registered; the error says why.
        OSError: Too little space, or COLMAP's process was ended.
    """
    check_space(target.root, len(key_frames) * SFM_BYTES_PER_FRAME)
    remove_inside(target.root, target.sfm.name)
    result = call_apart(
        reconstruct,
        files.frames,
        key_frames.names,
        key_frames.indices,
        key_frames.times_s,
        camera=source.known_camera(key_frames),
        focal_prior_px=source.focal_prior_px(key_frames),
        lens=source.estimated_lens,
        workdir=target.sfm,
        ordered=key_frames.is_video,
        jobs=jobs,
        name=NAME,
        ahead=ahead,
        report=lambda _, share: report("poses", share),
    )
    result.save(target.sfm)
    notes = _notes_of(result, is_video=key_frames.is_video)
    if notes:
        _save_pose_notes(target, notes)
    return f"{len(result.trajectory)} of {len(key_frames)} frames, {result.report['method']}"


def _notes_of(result: Reconstruction, *, is_video: bool) -> list[str]:
    """What a reconstruction leaves open."""
    notes = []
    lost = result.report["tracks_lost"]
    if lost and is_video:
        notes.append(f"poses come from SIFT matches and not from feature tracks: {lost}")
    sigma_px, focal_px = result.report["focal_sigma_px"], result.trajectory.camera.focal_px
    if sigma_px is not None and sigma_px > UNSURE_FOCAL * focal_px:
        notes.append(
            f"The focal length came out at {focal_px:.0f} px, but these frames show it only "
            f"to {sigma_px / focal_px:.1%} (standard deviation). Sources may be farther off than "
            "their covariance says: give --focal or --camera, or film on an arc around the scene."
        )
    return notes


def adopt_poses(given: NamedPoses, key_frames: KeyFrames, files: RunFiles, target: RunFiles) -> str:
    """Matches given poses to the key frames and holds them against the images.

    Args:
        given: The poses.
        key_frames: The frames.
        files: Where their images are.
        target: Where to write.

    Returns:
        A summary.

    Raises:
        BadInputError: Too few frames have one, or the images contradict them.
    """
    trajectory, _ = given.match_to_frames(
        [frame.source for frame in key_frames.frames],
        key_frames.indices,
        key_frames.times_s,
        size=(key_frames.width, key_frames.height),
    )
    stray = stray_rows(trajectory) if key_frames.is_video else np.zeros(0, dtype=np.int64)
    left_out = [str(index) for index in trajectory.indices[stray]]
    trajectory = trajectory.take(np.delete(np.arange(len(trajectory)), stray))
    images = FrameImages([files.frames / name for name in names_of(trajectory, key_frames)])
    try:
        notes = check_given_poses(trajectory, images)
    except BadInputError as error:
        raise BadInputError(f"{given.path}: {error}") from error
    target.sfm.mkdir(exist_ok=True)
    trajectory.save(target.sfm_trajectory)
    if left_out:
        notes += (f"Left out: frames {', '.join(left_out)}, whose given poses jump off the path.",)
    if notes:
        _save_pose_notes(target, notes)
    return f"{len(trajectory)} of {len(key_frames)} frames, given"


def _save_pose_notes(files: RunFiles, notes: Sequence[str]) -> None:
    files.pose_notes.write_text(json.dumps(list(notes), indent=1))


def load_pose_notes(files: RunFiles) -> tuple[str, ...]:
    """What there is to say of the poses: what the images left open, or why there are no tracks.

    Raises:
        BadInputError: The file is damaged.
    """
    if not files.pose_notes.exists():
        return ()
    try:
        return tuple(map(str, read_json(files.pose_notes)))
    except TypeError as error:
        raise BadInputError(f"{files.pose_notes}: not a list of notes ({error})") from error


def frames_with_poses(files: RunFiles, key_frames: KeyFrames) -> PosedFrames:
    """The key frames that have a pose in the world of the map."""
    trajectory = Trajectory.load(files.trajectory)
    return PosedFrames(
        folder=files.frames,
        names=names_of(trajectory, key_frames),
        indices=trajectory.indices,
        camera=trajectory.camera,
        trajectory=trajectory,
        full_size=key_frames.full_size,
        b_frames=np.intersect1d(trajectory.indices, key_frames.b_frames),
    )


def frames_at_rest(source: RecordingSource, key_frames: KeyFrames, folder: Path) -> PosedFrames:
    """The key frames of a camera at rest."""
    camera = source.known_camera(key_frames)
    if camera is None:
        longest = max(key_frames.width, key_frames.height)
        focal_px = source.focal_prior_px(key_frames) or GUESSED_FOCAL * longest
        camera = Camera.pinhole(key_frames.width, key_frames.height, focal_px)
    return PosedFrames(
        folder=folder,
        names=key_frames.names,
        indices=key_frames.indices,
        camera=camera,
        times_s=key_frames.times_s if key_frames.is_video else None,
    )


def check_rest(posed: PosedFrames, recording: Path) -> None:
    """Refuses frames that move, for a detector that needs a camera at rest.

    Raises:
        BadInputError: They do.
    """
    motion_px = posed.image_motion_px()
    if motion_px > MOVING_SHARE * posed.camera.width:
        raise BadInputError(
            f"{recording}: bos needs a camera at rest and the image moves by "
            f"{motion_px:.0f} px; use --detector registered"
        )


def names_of(trajectory: Trajectory, key_frames: KeyFrames) -> list[str]:
    """The file names of the frames of a trajectory."""
    names = dict(zip(key_frames.indices.tolist(), key_frames.names, strict=True))
    return [names[index] for index in trajectory.indices.tolist()]
