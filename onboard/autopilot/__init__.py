"""All that we say to an autopilot or a ground station: session, traffic, odometry. Sans-IO: bytes are returned."""
