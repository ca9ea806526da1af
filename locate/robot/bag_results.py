"""Plumes written as a ROS 2 bag that Foxglove, PlotJuggler and mcap readers open."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.errors import BadInputError
from geometry.removal import remove_inside
from locate.map.plume import PlumeMap
from locate.messages.bags import is_bag
from locate.robot.message_builder import MessageBuilder
from locate.robot.plume_tracks import PlumeUpdate, TrackState
from locate.robot.publisher import PlumePublisher, topic_type

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


def write_updates(folder: Path, updates: Sequence[PlumeUpdate], *, frame_id: str) -> Path:
    """Writes a ROS 2 bag of markers, points and sources as MCAP, in place of one that exists.

    Args:
        folder: The bag, a folder; the file in it has its name.
        updates: In the order in which they were found.
        frame_id: Of the world.

    Returns:
        The .mcap file.

    Raises:
        BadInputError: Something else is in its place.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    if folder.exists() and not is_bag(folder):
        raise BadInputError(f"{folder}: is not a bag; remove it or choose another output")
    types = get_typestore(Stores.LATEST)
    messages = MessageBuilder(types.types.__getitem__, frame_id, octets=np.ascontiguousarray)
    remove_inside(folder.parent, folder.name)
    connections: dict[str, Connection] = {}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def write(name: str, message: Any, stamp_ns: int) -> None:
            kind = topic_type(name)
            if name not in connections:
                topic = f"/locate/{name}"
                connections[name] = writer.add_connection(topic, kind, typestore=types)
            writer.write(connections[name], stamp_ns, types.serialize_cdr(message, kind))

        plume_publisher = PlumePublisher(messages, write)
        for update in updates:
            plume_publisher.publish_updates([update])
    return folder / f"{folder.name}.mcap"


def write_map_bag(folder: Path, plume_map: PlumeMap, *, frame_id: str, stamp_ns: int) -> Path:
    """Writes the plumes of an offline run as `write_updates` does, in place of what exists.

    Args:
        folder: The bag.
        plume_map: In metres, in the robot's own world.
        frame_id: Of that world.
        stamp_ns: Of the last frame.
    """
    remove_inside(folder.parent, folder.name)
    updates = [
        PlumeUpdate(plume=plume, state=TrackState.CONFIRMED, stamp_ns=stamp_ns)
        for plume in plume_map.plumes
    ]
    return write_updates(folder, updates, frame_id=frame_id)
