"""What goes out over Zenoh: images, radar scans, the truth, and how much has been sent.

Everything is dropped rather than waited for: a slow subscriber must not slow the simulation.
"""

import json
from typing import Any, Final

import msgspec

from onboard.messages import CameraPoints, Pseudoranges, RadarDetections, SimStatus, TrafficTruth, Truth
from onboard.wire.points import encode_points
from onboard.wire.radar import encode_radar
from onboard.wire.ranges import encode_ranges
from simlink.server.links import LinkError


def check_vehicle(vehicle: str) -> str:
    """The vehicle's id if it can stand in a key. Raises LinkError."""
    if not vehicle.isascii() or any(c in "*$?# " for c in vehicle) or "" in vehicle.split("/"):
        raise LinkError(f"bad vehicle id {vehicle!r}: ASCII without * $ ? # or blanks, and no empty part")
    return vehicle


# so that a daemon started second is joined within the second; Zenoh's own slows down to 4 s
RETRY: Final = {"period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5}


class ZenohPublisher:
    """Five publishers on one session; `ZenohPublisher.open` connects, and keeps trying in the background."""

    def __init__(self, session: Any, vehicle: str, camera: str, radar: str) -> None:
        import zenoh  # noqa: PLC0415  # a run without Zenoh need not load it

        drop = zenoh.CongestionControl.DROP
        keys = (
            f"onboard/{vehicle}/camera/{camera}/points",
            f"simlink/{vehicle}/truth",
            f"simlink/{vehicle}/status",
            f"onboard/{vehicle}/radar/{radar}/detections",
            f"simlink/{vehicle}/traffic",
        )
        self._session, self._vehicle = session, vehicle
        self._kind = {"congestion_control": drop, "encoding": zenoh.Encoding.APPLICATION_JSON}
        self._points, self._truth, self._status, self._radar, self._traffic = (
            session.declare_publisher(key, **self._kind) for key in keys
        )

    @classmethod
    def open(cls, endpoint: str, vehicle: str, camera: str, radar: str) -> "ZenohPublisher":
        """Connect to `endpoint` (such as tcp/127.0.0.1:7447) and to nothing else: no listening, no scouting.

        Blocks for half a second when no router is there yet. Raises LinkError for an endpoint that is none.
        """
        import zenoh  # noqa: PLC0415  # see above

        config = zenoh.Config()
        settings = {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "listen/endpoints": [],
            "connect/endpoints": [endpoint],
            "connect/retry": RETRY,
        }
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
            return cls(zenoh.open(config), vehicle, camera, radar)
        except zenoh.ZError as error:
            said = str(error).split(" at /")[0]
            raise LinkError(f"cannot use Zenoh endpoint {endpoint!r}: {said}") from error

    def has_viewer(self) -> bool:
        """Whether anybody subscribes to the images."""
        return bool(self._points.matching_status.matching)

    def put_points(self, points: CameraPoints) -> None:
        """Publish one image's points."""
        self._points.put(encode_points(points))

    def put_truth(self, truth: Truth) -> None:
        """Publish the truth."""
        self._truth.put(msgspec.json.encode(truth))

    def put_scan(self, scan: RadarDetections) -> None:
        """Publish one radar scan."""
        self._radar.put(encode_radar(scan))

    def put_ranges(self, epoch: Pseudoranges) -> None:
        """Publish what one aircraft's receiver measured; one publisher each, so `put` by key."""
        key = f"onboard/{self._vehicle}/gnss/{epoch.peer}/pseudoranges"
        self._session.put(key, encode_ranges(epoch), **self._kind)

    def put_traffic(self, truth: TrafficTruth) -> None:
        """Publish the truth of all other aircraft."""
        self._traffic.put(msgspec.json.encode(truth))

    def put_status(self, status: SimStatus) -> None:
        """Publish the counts."""
        self._status.put(msgspec.json.encode(status))

    def close(self) -> None:
        """End the session."""
        self._session.close()
