"""Where the frames of a run come from: a video, a folder of photos, or a robot's bag."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.lens_calibration import LensName
from geometry.named_poses import NamedPoses, read_camera, resize_camera
from geometry.pose_files import read_named_poses
from locate.messages.bags import TopicChoice, is_bag
from locate.messages.wiring import Wiring
from locate.pipeline.config import RunConfig
from locate.pipeline.fingerprint import fingerprint_path
from locate.recording import KeyFrames, Recording, open_recording
from locate.recording.bag import BagRecording
from locate.recording.opening import DEFAULT_MAX_SIDE
from locate.telemetry import telemetry_candidates

USE_FULL_SIZE = ("auto", "registered", "registered-plain")
"""Detectors that make use of frames at full size."""
BAG_OPTIONS = ("image_topic", "pose_topic", "world_frame")
"""Settings that only a bag has a use for."""


@dataclass(frozen=True, kw_only=True)
class RecordingSource:
    """A recording, and what its user and its own messages say of the camera.

    Attributes:
        config: The settings of the run.
        bag: The recording as a bag; None where it is none.
    """

    config: RunConfig
    bag: BagRecording | None

    @classmethod
    def of(cls, config: RunConfig) -> Self:
        """The source that a run is asked to read.

        Raises:
            BadInputError: An option of bags was given for something else, or a lens to be
                estimated where the camera is known.
        """
        source = cls(config=config, bag=_bag_of(config))
        source._refuse_lens_of_known_camera()
        return source

    def open_frames(self) -> Recording:
        """The frames, at the size of poses and at full size; each call has its own warnings.

        Raises:
            BadInputError: They cannot be read.
        """
        return replace(self._recording, warnings=list(self._recording.warnings))

    @cached_property
    def _recording(self) -> Recording:
        """Opened once: that decodes frames to see what they are like. Its frames are not read."""
        max_side = min(self.config.amounts.max_side, DEFAULT_MAX_SIDE)
        if self.bag is not None:
            return self.bag.open_recording(max_side=max_side, full_side=self._full_side)
        return open_recording(
            self.config.recording, max_side=max_side, full_side=self._full_side, one_camera=True
        )

    @property
    def _full_side(self) -> int | None:
        """Longest side of what is kept at full size, px; None where no detector makes use of it."""
        return self.config.amounts.max_side if self.config.detector in USE_FULL_SIZE else None

    def check_given_files(self) -> None:
        """Reads what the user gave of the camera, before the frames are read.

        Raises:
            BadInputError: A file cannot be read, or is for images of another aspect.
        """
        camera = self.known_camera(self.open_frames())
        if self.config.poses is not None:
            read_named_poses(self.config.poses, camera)

    def known_camera(self, frames: KeyFrames | Recording) -> Camera | None:
        """The camera of frames, where the user or the bag gave one."""
        size = frames.width, frames.height
        if self.config.camera is not None:
            return read_camera(self.config.camera, *size)
        if self.bag is not None and self.bag.camera is not None:
            return resize_camera(self.bag.camera, *size)
        return None

    @property
    def estimated_lens(self) -> LensName | None:
        """What is to be estimated of a lens that is not known; None for the usual."""
        return None if self.config.lens == "auto" else self.config.lens

    def focal_prior_px(self, key_frames: KeyFrames) -> float | None:
        """The focal length in px of the key frames, as given or by metadata."""
        if self.config.focal_px is None:
            return key_frames.focal_prior_px
        return self.config.focal_px * key_frames.width / self._recording.sizes.source[0]

    def given_poses(self, key_frames: KeyFrames) -> NamedPoses | None:
        """The poses of the user's file or of the bag."""
        camera = self.known_camera(key_frames)
        if self.config.poses is not None:
            return read_named_poses(self.config.poses, camera)
        return None if self.bag is None else self.bag.poses(camera)

    @property
    def has_given_poses(self) -> bool:
        """The poses are the user's or the bag's, where it has some."""
        return self.config.poses is not None or (self.bag is not None and self.bag.has_poses)

    def telemetry(self) -> tuple[Path, ...]:
        """The files that may say where the recording was made; a bag needs none."""
        if self.bag is not None and self.config.telemetry is None:
            return ()
        return telemetry_of(self.config.recording, self.config.telemetry)

    def focal_notes(self, key_frames: KeyFrames, *, at_rest: bool) -> tuple[str, ...]:
        """What the reader of the map should know of the focal length."""
        config = self.config
        given = config.camera or config.poses or config.focal_px
        given = given or (self.bag is not None and self.bag.camera is not None)
        if given or key_frames.focal_prior_px is not None:
            return ()
        how = "guessed" if at_rest else "estimated from the frames"
        return (f"The focal length is {how}; give it with --focal or --camera if you know it.",)

    def frame_inputs(self) -> dict[str, Any]:
        """What the key frames depend on."""
        config = self.config
        inputs: dict[str, Any] = {
            "recording": fingerprint_path(config.recording),
            "max_frames": config.amounts.max_frames,
            "max_side": config.amounts.max_side,
            "full_side": self._full_side,
            "shot": config.shot,
        }
        return inputs if self.bag is None else inputs | {"image_topic": config.image_topic}

    def pose_inputs(self) -> dict[str, Any]:
        """What else the poses depend on."""
        config = self.config
        inputs: dict[str, Any] = {
            name: None if path is None else fingerprint_path(path)
            for name, path in (("poses", config.poses), ("camera", config.camera))
        }
        inputs |= {"focal_px": config.focal_px, "lens": config.lens}
        if self.bag is not None:
            inputs |= {"pose_topic": config.pose_topic, "world_frame": config.world_frame}
        return inputs

    def _refuse_lens_of_known_camera(self) -> None:
        if self.estimated_lens is None:
            return
        of_bag = self.bag is not None and self.bag.camera is not None
        if self.config.camera is not None or self.has_given_poses or of_bag:
            raise BadInputError(
                f"--lens {self.estimated_lens}: the camera is known and nothing of its lens is "
                "estimated; leave out --lens, or what gives the camera"
            )


def _bag_of(config: RunConfig) -> BagRecording | None:
    """The recording as a bag; None where it is none."""
    if is_bag(config.recording):
        topics = TopicChoice(image=config.image_topic, pose=config.pose_topic)
        frame = config.world_frame
        wiring = Wiring() if frame is None else Wiring(world_frame=frame)
        return BagRecording(path=config.recording, topics=topics, wiring=wiring)
    asked = [name for name in BAG_OPTIONS if getattr(config, name) is not None]
    if asked:
        option = f"--{asked[0].replace('_', '-')}"
        raise BadInputError(f"{config.recording}: is no bag; leave {option} out")
    return None


def telemetry_of(recording: Path, asked: Path | None) -> tuple[Path, ...]:
    """The files that may say where a recording was made: the one asked for, or all that may."""
    return (asked,) if asked is not None else telemetry_candidates(recording)
