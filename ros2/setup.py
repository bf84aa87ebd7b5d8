"""The ament_python package `wingline`, with a node, a launch file, parameters and views."""

from glob import glob

from setuptools import setup

SHARE = "share/wingline"

setup(
    name="wingline-ros2",  # pip's `wingline` is the program itself
    version="0.2.0",
    packages=["wingline"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/wingline"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/launch", glob("launch/*.py")),  # noqa: PTH207 - paths relative to this folder, as text
        (f"{SHARE}/config", glob("config/*")),  # noqa: PTH207
    ],
    entry_points={"console_scripts": ["onboard_ros2 = wingline.node:main"]},
)
