"""`ros2 run wingline onboard_ros2`: the same as `onboard ros2`. Needs the extra `ros2`."""

import sys

from onboard.commands.cli import main as onboard


def main() -> int:
    """Run the node with the arguments of this process."""
    return onboard(["ros2", *sys.argv[1:]])
