"""The ROS 2 package of plume-locate; the node itself is `locate.robot.ros2`."""
