"""ROS 2: what cameras send, and our records as its messages."""
