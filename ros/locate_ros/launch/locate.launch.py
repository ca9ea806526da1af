"""ros2 launch locate_ros locate.launch.py image:=/camera/image_raw camera_info:=/camera/info."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "image": ("/camera/image_raw", "Topic of the images; of the raw ones, also for compressed."),
    "camera_info": ("/camera/camera_info", "Topic of the camera's calibration."),
    "odometry": ("/odom", "Topic of the odometry, for pose_source: odometry."),
    "pose": ("/pose", "Topic of the body's pose, for pose_source: pose."),
    "parameters": ("", "A parameter file; the default is config/locate.yaml of this package."),
}


def generate_launch_description() -> LaunchDescription:
    """One node; its topics are arguments."""
    share = Path(get_package_share_directory("locate_ros"))
    defaults = {name: default for name, (default, _) in ARGUMENTS.items()}
    defaults["parameters"] = str(share / "config" / "locate.yaml")
    declared = [
        DeclareLaunchArgument(name, default_value=defaults[name], description=text)
        for name, (_, text) in ARGUMENTS.items()
    ]
    image = LaunchConfiguration("image")
    node = Node(
        package="locate_ros",
        executable="locate_node",
        name="locate",
        parameters=[LaunchConfiguration("parameters")],
        remappings=[
            ("image", image),
            ("image/compressed", [image, "/compressed"]),
            *((name, LaunchConfiguration(name)) for name in ("camera_info", "odometry", "pose")),
        ],
        output="screen",
    )
    return LaunchDescription([*declared, node])
