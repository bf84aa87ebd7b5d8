"""SYS_STATUS and BATTERY_STATUS: voltages, as pymavlink reads them; nothing where nobody measures."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Battery, Message
from onboard.wire.mavlink.decode import MavlinkDecoder
from tests.support.pymavlink_reference import Reference

RECV = 1_735_689_605_000_000_000
NONE = 65535


def decoded(message: Any) -> list[Message]:
    data = message.pack(dialect.MAVLink(None, srcSystem=1, srcComponent=1))
    records: list[Message] = MavlinkDecoder(stream=False).decode(data, RECV)
    assert records == Reference(stream=False).decode(data, RECV)
    return records


def battery(*cells: int, number: int = 0, further: tuple[int, ...] = (0, 0, 0, 0)) -> Any:
    voltages = [*cells, *[NONE] * (10 - len(cells))]
    return dialect.MAVLink_battery_status_message(
        number, 0, 0, 2500, voltages, 1200, 10, 10, 80, 600, 1, voltages_ext=list(further)
    )


def volts(records: list[Message]) -> list[float]:
    return [record.voltage_v for record in records if isinstance(record, Battery)]


@pytest.mark.parametrize(("millivolts", "expected"), [(11_100, [11.1]), (0, []), (NONE, [])])
def test_sys_status(millivolts: int, expected: list[float]) -> None:
    message = dialect.MAVLink_sys_status_message(1, 2, 3, 400, millivolts, -1, 55, 1, 2, 3, 4, 5, 6, 7, 8, 9)
    assert volts(decoded(message)) == pytest.approx(expected)


def test_battery_status_adds_the_cells() -> None:
    assert volts(decoded(battery(4100, 4000, 3900))) == pytest.approx([12.0])
    assert volts(decoded(battery(*[4000] * 10, further=(4000, 4000, 0, 0)))) == pytest.approx([48.0])
    assert volts(decoded(battery())) == []


def test_another_battery_may_drive_no_motor() -> None:
    assert volts(decoded(battery(4100, 4000, 3900, number=1))) == []
