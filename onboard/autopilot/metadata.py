"""What a ground station shows of our parameters beside their values: files, and the message that leads to them.

The layout of the files is that of MAVLink's component metadata: `general.json` names `parameters.json`.
"""

from collections.abc import Iterable
from typing import Any, Final

import msgspec

from onboard import __version__
from onboard.autopilot.parameters import KEYS
from onboard.autopilot.requests import stamp
from onboard.messages import ComponentMetadata
from onboard.wire.mavlink.files import crc32

GENERAL, PARAMETERS = "general.json", "parameters.json"
PARAMETER_TYPE: Final = 1  # COMP_METADATA_TYPE
UNITS: Final = {"_M_S": "m/s", "_M": "m", "_DEG": "deg", "_S": "s", "_PX": "px"}  # by the end of a name
DESCRIPTIONS: Final = {
    "LDR_SIZE_M": "Leader: size, between the two outer points",
    "LDR_SIZE_SIG_M": "Leader: standard deviation of the size",
    "LDR_OWN_TILT_DEG": "Own roll and pitch: standard deviation of their bias",
    "LDR_OWN_YAW_DEG": "Own yaw: standard deviation of its bias",
    "LDR_OWN_VEL_M_S": "Own velocity: standard deviation of its bias",
    "LDR_DELAY_SIG_S": "Camera: standard deviation of the delay",
    "LDR_COAST_S": "Leader: without images for this long, it coasts",
    "LDR_VALID_S": "Leader: without images for this long, the estimate is not valid",
    "LDR_RESET_S": "Leader: without images for this long, the estimate starts anew",
    "CAM_F_PX": "Camera: focal length",
    "CAM_SIGMA_PX": "Camera: standard deviation of an image point",
    "CAM_ROLL_DEG": "Camera: roll of its mount",
    "CAM_PITCH_DEG": "Camera: pitch of its mount",
    "CAM_YAW_DEG": "Camera: yaw of its mount",
    "CAM_X_M": "Camera: place forward of the autopilot",
    "CAM_Y_M": "Camera: place to the right of the autopilot",
    "CAM_Z_M": "Camera: place below the autopilot",
    "CAM_DELAY_S": "Camera: how much older than its stamp an image is",
}


class Metadata:
    """Metadata of the parameters with these names, offered by a component."""

    def __init__(self, names: Iterable[str], component: int) -> None:
        self._uri = f"mftp://[;comp={component}]"
        parameters = {"version": 1, "parameters": [_parameter(name) for name in names]}
        described = msgspec.json.encode(parameters)
        where = {"type": PARAMETER_TYPE, "uri": f"{self._uri}{PARAMETERS}", "fileCrc": crc32(described)}
        general = {
            "version": 1,
            "vendorName": "wingline",
            "modelName": "onboard",
            "firmwareVersion": __version__,
            "metadataTypes": [where],
        }
        self.files = {GENERAL: msgspec.json.encode(general), PARAMETERS: described}

    def message(self, now_ns: int) -> ComponentMetadata:
        """COMPONENT_METADATA, which leads to the files."""
        return ComponentMetadata(**stamp(now_ns), uri=f"{self._uri}{GENERAL}", crc=crc32(self.files[GENERAL]))


def _parameter(name: str) -> dict[str, Any]:
    group, _, description = DESCRIPTIONS[name].partition(": ")
    key = KEYS[name][0].rstrip(".012")
    return {
        "name": name,
        "type": "Float",
        "group": group,
        "shortDesc": description,
        "longDesc": f"{key} of the configuration. A value holds from the next start on.",
        "units": next(unit for end, unit in UNITS.items() if name.endswith(end)),
        "rebootRequired": True,
    }
