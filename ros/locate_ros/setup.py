"""Installs the launch file, the parameters, the viewers' layouts and the node's executable."""

from pathlib import Path

from setuptools import setup

NAME = "locate_ros"


def files_in(folder: str) -> list[str]:
    """Its files, by the names that setuptools wants."""
    return sorted(str(path) for path in Path(folder).iterdir() if path.is_file())


setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", files_in(folder)) for folder in ("launch", "config")),
    ],
    install_requires=["setuptools", "plume-locate"],
    zip_safe=True,
    license="Apache-2.0",
    description="Finds plumes and leaks live from a robot's camera",
    entry_points={"console_scripts": ["locate_node = locate.robot.ros2:main"]},
)
