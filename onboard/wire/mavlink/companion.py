"""Encoders of ONBOARD_COMPUTER_STATUS and CAMERA_INFORMATION, for ground stations."""

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import CameraInformation, ComputerStatus, Message

UNKNOWN_8, UNKNOWN_TEMPERATURE, UNKNOWN_SPEED, UNKNOWN_32 = 255, 127, 32_767, 2**32 - 1
TEXT_LENGTH: Final = 32


def _computer_status(m: Any) -> list[Any]:
    def filled(values: Sequence[int], length: int, unknown: int) -> list[int]:
        return [*values[:length], *[unknown] * (length - len(values))]

    def mebibytes(amount: int | None) -> int:
        return UNKNOWN_32 if amount is None else min(amount // 2**20, UNKNOWN_32 - 1)

    board = UNKNOWN_TEMPERATURE if m.temperature is None else max(min(round(m.temperature), 126), -128)
    none = [UNKNOWN_32] * 6
    storage = (mebibytes(m.storage_used), mebibytes(m.storage_total))
    return [
        dialect.MAVLink_onboard_computer_status_message(
            m.t_ns // 1000,
            round(m.uptime * 1000) % 2**32,
            0,
            filled([min(round(p), 100) for p in m.cpu_percent], 8, UNKNOWN_8),
            [UNKNOWN_8] * 10,
            [UNKNOWN_8] * 4,
            [UNKNOWN_8] * 10,
            board,
            [UNKNOWN_TEMPERATURE] * 8,
            [UNKNOWN_SPEED] * 4,
            mebibytes(m.memory_used),
            mebibytes(m.memory_total),
            [UNKNOWN_32] * 4,
            filled(storage[:1], 4, UNKNOWN_32),
            filled(storage[1:], 4, UNKNOWN_32),
            *[none] * 5,
        )
    ]


def _camera_information(m: Any) -> list[Any]:
    """The lens's focal length and the sensor's size in mm are not known."""

    def text(words: str) -> list[int]:
        return list(words.encode("ascii", "replace")[: TEXT_LENGTH - 1].ljust(TEXT_LENGTH, b"\0"))

    major, minor, patch = m.version
    return [
        dialect.MAVLink_camera_information_message(
            m.t_ns // 1_000_000 % 2**32,
            text("wingline"),
            text(m.name),
            patch << 16 | minor << 8 | major,
            *[math.nan] * 3,
            m.width_px,
            m.height_px,
            0,
            dialect.CAMERA_CAP_FLAGS_HAS_TRACKING_GEO_STATUS,
            0,
            b"",
        )
    ]


ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {
    ComputerStatus: _computer_status,
    CameraInformation: _camera_information,
}
