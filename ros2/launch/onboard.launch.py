"""The node, with the parameter file of this package or another one: `params:=FILE`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Describe what `ros2 launch wingline onboard.launch.py` starts."""
    default = PathJoinSubstitution([FindPackageShare("wingline"), "config", "onboard.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=default, description="parameter file of the node"),
            DeclareLaunchArgument(
                "namespace", default_value="", description="before all topics but the global ones"
            ),
            Node(
                package="wingline",
                executable="onboard_ros2",
                name="onboard",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
