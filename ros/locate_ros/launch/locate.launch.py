"""The node, a viewer and a recording: ros2 launch locate_ros locate.launch.py --show-args."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory("locate_ros")) / "config"
ARGUMENTS = {
    "image": ("/camera/image_raw", "Topic of the images; of the raw ones, also for compressed."),
    "camera_info": ("/camera/camera_info", "Topic of the camera's calibration."),
    "odometry": ("/odom", "Topic of the odometry, for pose_source: odometry."),
    "pose": ("/pose", "Topic of the body's pose, for pose_source: pose."),
    "parameters": (str(CONFIG / "locate.yaml"), "A parameter file."),
    "bagfile": ("", "A recording to play, beside the node."),
    "visualize": ("false", "Open RViz: true or false."),
    "fixed_frame": ("map", "Of RViz; the node's world_frame."),
}


def generate_launch_description() -> LaunchDescription:
    """The node; RViz and `ros2 bag play` where they are asked for."""
    asked = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    plays = NotEqualsSubstitution(asked["bagfile"], "")
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            Node(
                package="locate_ros",
                executable="locate_node",
                name="locate",
                parameters=[asked["parameters"]],
                remappings=[
                    ("image", asked["image"]),
                    ("image/compressed", [asked["image"], "/compressed"]),
                    *((name, asked[name]) for name in ("camera_info", "odometry", "pose")),
                ],
                output="screen",
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(CONFIG / "locate.rviz"), "-f", asked["fixed_frame"]],
                parameters=[{"use_sim_time": plays}],
                remappings=[("image", asked["image"])],
                condition=IfCondition(asked["visualize"]),
            ),
            ExecuteProcess(
                cmd=["ros2", "bag", "play", asked["bagfile"], "--clock"],
                condition=IfCondition(plays),
                output="screen",
            ),
        ]
    )
