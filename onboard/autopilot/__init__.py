"""MAVLink output to autopilots and ground stations; sans-IO, so bytes are returned."""
