"""Where everything is in the folder of a run."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RunFiles:
    """The files of a run folder, or of the folder in which a stage builds its share of them.

    Attributes:
        root: The folder.
    """

    root: Path

    @property
    def config(self) -> Path:
        """The settings of the run, YAML."""
        return self.root / "config.yaml"

    @property
    def log(self) -> Path:
        """What was done, one JSON object a line."""
        return self.root / "log.jsonl"

    @property
    def frames(self) -> Path:
        """The folder of the key frames."""
        return self.root / "frames"

    @property
    def frame_index(self) -> Path:
        """What is known of each key frame."""
        return self.frames / "index.json"

    @property
    def sfm(self) -> Path:
        """The folder of the reconstruction, in a frame of its own."""
        return self.root / "sfm"

    @property
    def sfm_trajectory(self) -> Path:
        """The poses as they were reconstructed or given."""
        return self.sfm / "trajectory.json"

    @property
    def sfm_report(self) -> Path:
        """Figures of the reconstruction; missing where the poses were given."""
        return self.sfm / "report.json"

    @property
    def sfm_points(self) -> Path:
        """The sparse points as they were reconstructed."""
        return self.sfm / "points.npz"

    @property
    def pose_notes(self) -> Path:
        """What there is to say of the poses, where there is; a list in JSON."""
        return self.sfm / "notes.json"

    @property
    def placement(self) -> Path:
        """What took the reconstruction to the world of the map."""
        return self.root / "placement.json"

    @property
    def trajectory(self) -> Path:
        """The poses in the world of the map."""
        return self.root / "trajectory.json"

    @property
    def points(self) -> Path:
        """The sparse points in the world of the map."""
        return self.root / "points.npz"

    @property
    def detections(self) -> Path:
        """The folder of the detections, one file a measured frame."""
        return self.root / "detections"

    @property
    def evidence(self) -> Path:
        """The summed evidence grid."""
        return self.root / "evidence.npz"

    @property
    def map(self) -> Path:
        """The answer."""
        return self.root / "map.json"

    @property
    def plume_points(self) -> Path:
        """The plumes as a point cloud."""
        return self.root / "plumes.ply"

    @property
    def scene_points(self) -> Path:
        """The scene with its plumes as a point cloud, where the camera moved."""
        return self.root / "scene.ply"

    @property
    def plume_bag(self) -> Path:
        """The plumes as a bag, where the recording was one; a folder."""
        return self.root / "plumes"

    @property
    def overlay(self) -> Path:
        """The frames in a row with the evidence and the plumes, a video."""
        return self.root / "overlay.mp4"

    @property
    def report(self) -> Path:
        """The page for people."""
        return self.root / "report.html"
