"""Publishing over Zenoh: images, radar scans, pseudoranges, truth and counts.

Records are dropped rather than delayed: a slow subscriber must not slow the simulation.
"""

import json
from typing import Any, Final

import msgspec

from onboard.messages import (
    CameraDetections,
    CameraPoints,
    Picture,
    Pseudoranges,
    RadarDetections,
    SimStatus,
    TrafficTruth,
    Truth,
)
from simlink.server.links import LinkError


def check_vehicle(vehicle: str) -> str:
    """Return the vehicle's id if it may be part of a key. Raises LinkError."""
    if not vehicle.isascii() or any(c in "*$?# " for c in vehicle) or "" in vehicle.split("/"):
        raise LinkError(f"bad vehicle id {vehicle!r}: use ASCII without * $ ? # or blanks, and no empty part")
    return vehicle


Images = CameraPoints | CameraDetections | Picture
Published = Images | RadarDetections | Pseudoranges | Truth | TrafficTruth | SimStatus

# connects within a second to a daemon that starts later; Zenoh's default slows down to 4 s
RETRY_OPTIONS: Final = {"period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5}


class ZenohPublisher:
    """A publisher of each kind of record.

    `ZenohPublisher.open` connects and keeps trying in the background.
    """

    def __init__(self, session: Any, vehicle: str, camera: str, radar: str) -> None:
        import zenoh  # noqa: PLC0415  # a run without Zenoh need not load it

        drop = zenoh.CongestionControl.DROP
        keys: dict[type[Published], str] = {
            CameraPoints: f"onboard/{vehicle}/camera/{camera}/points",
            CameraDetections: f"onboard/{vehicle}/camera/{camera}/detections",
            RadarDetections: f"onboard/{vehicle}/radar/{radar}/detections",
            Picture: f"simlink/{vehicle}/picture",
            Truth: f"simlink/{vehicle}/truth",
            TrafficTruth: f"simlink/{vehicle}/traffic",
            SimStatus: f"simlink/{vehicle}/status",
        }
        self._session, self._vehicle = session, vehicle
        self._options = {"congestion_control": drop, "encoding": zenoh.Encoding.APPLICATION_JSON}
        self._publishers = {kind: session.declare_publisher(key, **self._options) for kind, key in keys.items()}

    @classmethod
    def open(cls, endpoint: str, vehicle: str, camera: str, radar: str) -> "ZenohPublisher":
        """Connect to `endpoint`, such as tcp/127.0.0.1:7447, without listening or scouting.

        It blocks for half a second if no router runs yet. Raises LinkError for an invalid endpoint.
        """
        import zenoh  # noqa: PLC0415  # see above

        config = zenoh.Config()
        settings = {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "listen/endpoints": [],
            "connect/endpoints": [endpoint],
            "connect/retry": RETRY_OPTIONS,
        }
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
            return cls(zenoh.open(config), vehicle, camera, radar)
        except zenoh.ZError as error:
            reason = str(error).split(" at /")[0]
            raise LinkError(f"cannot use Zenoh endpoint {endpoint!r}: {reason}") from error

    def has_viewer(self) -> bool:
        """Whether the images have a subscriber."""
        return bool(self._publishers[CameraPoints].matching_status.matching)

    def put(self, record: Published) -> None:
        """Publish one record as JSON."""
        if isinstance(record, Pseudoranges):  # each aircraft has its own key
            key = f"onboard/{self._vehicle}/gnss/{record.peer}/pseudoranges"
            self._session.put(key, msgspec.json.encode(record), **self._options)
        else:
            self._publishers[type(record)].put(msgspec.json.encode(record))

    def close(self) -> None:
        """End the session."""
        self._session.close()
