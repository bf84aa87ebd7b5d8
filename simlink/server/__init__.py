"""Real time: paces the bytes, serves them over UDP, TCP and Zenoh, and answers commands."""
