"""Messages that are not in pymavlink's dialects, as its messages are made."""

import struct
from typing import Any, ClassVar, cast

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.wire.mavlink.frame import UNLISTED_EXTRA


class UnlistedMessage(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink has no types
    """A message of which the class gives number, name and layout."""

    id: ClassVar[int]
    msgname: ClassVar[str]
    layout: ClassVar[struct.Struct]

    def __init__(self, *fields: Any) -> None:
        super().__init__(self.id, self.msgname)
        self._fields = fields

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The frame."""
        payload = self.layout.pack(*self._fields)
        return cast(bytes, self._pack(mav, UNLISTED_EXTRA[self.id], payload, force_mavlink1=force_mavlink1))
