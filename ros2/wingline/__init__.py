"""`onboard ros2` as an executable of a ROS 2 package."""
