"""Installs the launch file, the parameters and the node's executable."""

from setuptools import setup

NAME = "locate_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/locate.launch.py"]),
        (f"share/{NAME}/config", ["config/locate.yaml"]),
    ],
    install_requires=["setuptools", "plume-locate"],
    zip_safe=True,
    license="Apache-2.0",
    description="Finds plumes and leaks live from a robot's camera",
    entry_points={"console_scripts": ["locate_node = locate.robot.ros2:main"]},
)
