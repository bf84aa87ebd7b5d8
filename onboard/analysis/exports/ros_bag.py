"""Estimates as a ROS 2 bag (rosbag2, MCAP). Needs the extra `ros2`."""

from pathlib import Path
from typing import Any, Final

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from onboard.messages import Health, Output
from onboard.messages.ros import Ros2Config
from onboard.wire.ros.messages import RosEncoder

VERSION: Final = 8  # of the metadata: older ROS reads it, newer as well


class RosBagWriter:
    """A folder with a bag, on the boot clock. Raises OSError.

    Its frame `map` is at the autopilot's origin."""

    def __init__(self, path: Path, config: Ros2Config) -> None:
        self._encoder = RosEncoder(config)
        self._writer = Writer(path, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self._connections: dict[str, Any] = {}

    def write(self, record: Output | Health) -> None:
        """Append the messages of a record."""
        if record.t_ns <= 0:
            return
        for message in self._encoder.encode(record, record.t_ns):
            topic = message.topic
            if topic.name not in self._connections:
                self._connections[topic.name] = self._writer.add_connection(
                    topic.name, topic.kind, typestore=self._encoder.store
                )
            self._writer.write(self._connections[topic.name], message.t_ns, message.data)

    def close(self) -> None:
        """Write the index and the metadata."""
        self._writer.close()
