"""`locate robot`: plumes found live on a robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geometry.errors import BadInputError
from locate.commands.console import Output, err, out
from locate.commands.given_values import with_checked_values
from locate.journal.progress import progress_bars

if TYPE_CHECKING:
    from locate.robot.settings import LocatorSettings

WorldFrame = Annotated[str, typer.Option(help="Frame of the map, Z up.")]
BodyFrame = Annotated[
    str, typer.Option(help="Frame that the pose is of; else the odometry's child frame.")
]
WidthPx = Annotated[
    int | None, typer.Option(help="Wider images are shrunk to this width; else to 640.")
]
Neighbours = Annotated[
    int | None,
    typer.Option(help="Key frames that each is compared with; else 8, fewer are faster."),
]
DetectorWorkers = Annotated[
    int | None,
    typer.Option(
        "--lookers",
        help="Key frames processed at the same time, each by its own processor; else 1.",
    ),
]
Rectified = Annotated[bool, typer.Option("--rectified", help="The images are rectified already.")]

robot = typer.Typer(
    name="robot", help="Find plumes live, on a robot.", no_args_is_help=True, add_completion=False
)


@robot.command("ros2", context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def run_ros2_node(context: typer.Context) -> None:
    """Run the ROS 2 node; what follows goes to ROS, such as --ros-args -r image:=/camera/image.

    The parameters, topics and services are in docs/robot.md.
    """
    from locate.robot.ros2 import main

    main(context.args)


@robot.command("bag")
@with_checked_values
def play_bag(
    recording: Annotated[
        Path, typer.Argument(help="A .mcap, .db3 or .bag file, or the folder of a ROS 2 bag.")
    ],
    output: Output,
    image_topic: Annotated[
        str | None, typer.Option(help="Of the images; needed where the bag has several.")
    ] = None,
    info_topic: Annotated[
        str | None, typer.Option(help="Of the camera_info; else the one beside the images.")
    ] = None,
    pose_topic: Annotated[
        str | None, typer.Option(help="Odometry or a pose; else TF if it is there.")
    ] = None,
    world_frame: WorldFrame = "map",
    body_frame: BodyFrame = "",
    rectified: Rectified = False,
    width_px: WidthPx = None,
    neighbours: Neighbours = None,
) -> None:
    """Play a robot's recording into the locator: map.json, and plumes/plumes.mcap for a viewer."""
    from locate.export.table import map_table
    from locate.messages.bags import TopicChoice
    from locate.messages.wiring import Wiring
    from locate.robot.bag_playing import locate_in_bag

    settings = _make_settings(width_px=width_px, neighbours=neighbours)
    with progress_bars(err) as report:
        plume_map = locate_in_bag(
            recording,
            output,
            topics=TopicChoice(image=image_topic, camera_info=info_topic, pose=pose_topic),
            wiring=Wiring(world_frame=world_frame, body_frame=body_frame, rectified=rectified),
            settings=settings,
            report=report,
        )
    out.print(map_table(plume_map))


@robot.command("dds")
@with_checked_values
def run_dds_node(
    image_topic: Annotated[
        str, typer.Option(help="Of the images; compressed ones end with /compressed.")
    ] = "/image",
    info_topic: Annotated[
        str, typer.Option(help="Of the camera_info; else the one beside the images.")
    ] = "",
    pose_topic: Annotated[
        str | None, typer.Option(help="Odometry, or with --pose a pose; else TF.")
    ] = None,
    pose: Annotated[
        bool, typer.Option("--pose", help="The pose topic is PoseWithCovarianceStamped.")
    ] = False,
    world_frame: WorldFrame = "map",
    body_frame: BodyFrame = "",
    rectified: Rectified = False,
    domain: Annotated[int, typer.Option(min=0, max=232, help="ROS_DOMAIN_ID of the robot.")] = 0,
    output: Annotated[
        Path | None, typer.Option(help="Folder that the command save writes into; else ~/locate.")
    ] = None,
    width_px: WidthPx = None,
    neighbours: Neighbours = None,
    detector_workers: DetectorWorkers = None,
) -> None:
    """Run the node on plain DDS, beside a ROS 2 robot on which nothing can be installed."""
    from locate.messages.wiring import PoseSource, Wiring
    from locate.robot.dds import OUTPUT, DdsNode, TopicNames
    from locate.robot.dds_transport import DdsTransport

    if pose and pose_topic is None:
        raise BadInputError("--pose states what the pose topic is; give --pose-topic with it")
    source: PoseSource = "tf" if pose_topic is None else "pose" if pose else "odometry"
    wiring = Wiring(
        world_frame=world_frame,
        body_frame=body_frame,
        pose_source=source,
        rectified=rectified,
    )
    settings = _make_settings(
        width_px=width_px, neighbours=neighbours, detector_workers=detector_workers
    )
    names = TopicNames(image=image_topic, camera_info=info_topic, pose=pose_topic or "")
    node = DdsNode(DdsTransport(domain), wiring, names, settings=settings, output=output or OUTPUT)
    try:
        while True:
            node.spin_once()
    except KeyboardInterrupt:
        pass
    finally:
        node.close()


def _make_settings(**asked: Any) -> "LocatorSettings":
    """The locator's settings, with what was asked for."""
    from locate.robot.settings import LocatorSettings

    return LocatorSettings(**{name: value for name, value in asked.items() if value is not None})
