"""A robot's recording played into a `Locator`."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from detect.detection import Detector
from geometry.errors import BadInputError
from geometry.reports import Report, ignore_report
from geometry.threads import with_one_thread
from locate.map.plume import PlumeMap
from locate.messages.bags import BagTopics, TopicChoice, open_bag
from locate.messages.wiring import Wiring
from locate.robot.bag_results import write_updates
from locate.robot.message_adapter import MessageAdapter
from locate.robot.plume_tracks import PlumeUpdate
from locate.robot.settings import LocatorSettings


@with_one_thread
def locate_in_bag(
    path: Path,
    output: Path,
    *,
    topics: TopicChoice,
    wiring: Wiring,
    settings: LocatorSettings | None = None,
    detector: Detector | None = None,
    report: Report = ignore_report,
) -> PlumeMap:
    """Plays a bag into a `Locator`; writes map.json and a bag of its updates, plumes/plumes.mcap.

    Args:
        path: The bag.
        output: A folder; made where it is missing.
        topics: Of the bag.
        wiring: How the robot's frames hang together; its pose source is set by `topics`.
        settings: Of the `Locator`; None takes its defaults.
        detector: None takes that of the `Locator`.
        report: Called with the share that has been played.

    Raises:
        BadInputError: The bag cannot be read, or does not hold what is needed.
    """
    with open_bag(path) as reader:
        chosen = BagTopics(reader, path, topics)
        adapter = MessageAdapter(
            chosen.with_pose_source(wiring), settings=settings, detector=detector, threaded=False
        )
        updates = list(_feed_messages(chosen, adapter, report))
        if adapter.locator is None or not adapter.locator.counts.key_frames:
            raise BadInputError(f"{path}: no frame could be used ({adapter.find_problem()})")
        updates += adapter.locator.finish()
    output.mkdir(parents=True, exist_ok=True)
    plume_map = adapter.locator.plume_map()
    plume_map.save(output / "map.json")
    write_updates(output / "plumes", updates, frame_id=wiring.world_frame)
    return plume_map


def _feed_messages(
    topics: BagTopics, adapter: MessageAdapter, report: Report
) -> Iterator[PlumeUpdate]:
    """Feeds all messages, static transforms and a camera first; yields the updates."""
    assert topics.info is not None
    handlers: dict[str, Callable[[Any], None]] = {
        topic: adapter.add_static_transforms if static else adapter.add_transforms
        for topic, static in topics.transform_topics.items()
    }
    for topic, _, message in topics.read_messages(_static_topics(topics), adapter.count_refusal):
        handlers[topic](message)
    for _, _, message in topics.read_messages([topics.info], adapter.count_refusal):
        adapter.add_camera_info(message)
        if adapter.locator is not None:
            break
    handlers |= {topics.image: adapter.add_image, topics.info: adapter.add_camera_info}
    if topics.pose not in (None, "tf"):
        handlers[topics.pose] = adapter.add_body_pose
    for topic, time_ns, message in topics.read_messages(handlers, adapter.count_refusal):
        handlers[topic](message)
        report("bag", topics.share_played(time_ns))
        if adapter.locator is not None:
            yield from adapter.locator.updates()
    report("bag", 1.0)


def _static_topics(topics: BagTopics) -> list[str]:
    return [topic for topic, static in topics.transform_topics.items() if static]
