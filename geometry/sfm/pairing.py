"""Pairs of images that show the same: by tracks, or by SIFT."""

from collections.abc import Iterator

from geometry.arrays import GreyImage
from geometry.image_files import read_image
from geometry.sfm import checks, features, track_matches, tracks
from geometry.sfm.features import MatchedPair
from geometry.sfm.job import MappingJob
from geometry.threads import call_both


def pair_by_tracks(job: MappingJob) -> list[MatchedPair]:
    """Pairs of near frames by their tracks, of far ones by SIFT matches.

    Raises:
        BrokenTracksError: Tracks break, or the lens has no epipolar lines to hold them against.
    """
    if "FISHEYE" in job.start.model_name:
        raise tracks.BrokenTracksError("no epipolar line is straight in a fisheye")
    frames, far = call_both(
        job.jobs,
        lambda: tracks.follow_features(_images_of(job)),
        lambda: track_matches.match_far_frames(
            job.workdir / "far.db", job.image_dir, job.names, job.start
        ),
    )
    track_matches.write_tracks(
        job.database,
        job.names,
        job.start,
        frames,
        far,
        lambda share: job.progress("matching features", share),
        jobs=job.jobs,
    )
    return features.read_pairs(job.database, job.names)


def _images_of(job: MappingJob) -> Iterator[GreyImage]:
    for row, name in enumerate(job.names):
        yield read_image(job.image_dir / name)
        job.progress("finding features", (row + 1) / len(job.names))


def pair_by_sift(job: MappingJob) -> list[MatchedPair]:
    """Verified pairs; where few frames hang together, again with more features and every pair."""
    count = len(job.names)
    for fine in (False, True):
        counts = features.extract_features(
            job.database,
            job.image_dir,
            job.names,
            job.start,
            lambda share: job.progress("finding features", share),
            fine=fine,
        )
        if fine:
            checks.check_features(counts)
        job.progress("matching features", 0.0)
        many = count > features.EXHAUSTIVE_UP_TO
        features.match_features(job.database, sequential=many or (job.ordered and not fine))
        job.progress("matching features", 1.0)
        pairs = features.read_pairs(job.database, job.names)
        if checks.largest_component(pairs, count)[0] >= checks.MIN_SHARE * count:
            break
    return pairs
