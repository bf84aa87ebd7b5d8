"""The simulator in real time, over UDP, TCP and Zenoh."""
