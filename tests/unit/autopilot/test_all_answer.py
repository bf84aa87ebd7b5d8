"""Every message that we send can be requested, and its interval can be read and set, of its component or of
all."""

from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.output import AutopilotOutput
from onboard.autopilot.sent import Encoder
from onboard.messages import Attitude
from onboard.wire.mavlink.encode import ENCODE, message_number
from tests.support.emitted import (
    ANSWERS,
    CAMERA_COMPONENT_ID,
    FIXED,
    LINK,
    NOW_TIME_NS,
    OF_CAMERA,
    ON_REQUEST,
    STREAMS,
    answered,
    command,
    command_long,
    everything,
    sent,
)
from tests.support.leader import S

SET, GET, REQUEST = 511, 510, 512
ACCEPTED, DENIED = 0, 2
OF_SIMULATORS = {  # what only a simulated autopilot sends with our encoder
    *("SYSTEM_TIME", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GPS_GLOBAL_ORIGIN", "GPS_RAW_INT"),
    *("HIGHRES_IMU", "SERVO_OUTPUT_RAW", "SYS_STATUS", "GIMBAL_DEVICE_ATTITUDE_STATUS", "DISTANCE_SENSOR"),
    *("EXTENDED_SYS_STATE", "CURRENT_MODE"),
}


def kinds(frames: list[bytes]) -> Counter[tuple[int, int]]:
    """(component, message number) of frames, without the virtual leader's heartbeat."""
    kinds = ((frame[5:7], int.from_bytes(frame[7:10], "little")) for frame in frames)
    return Counter((sender[1], number) for sender, number in kinds if (sender[0], number) != (99, 0))


def ask(out: AutopilotOutput, name: str, number: int, *params: float, component: int | None = None) -> list[int]:
    """Results of the COMMAND_ACKs."""
    frames = out.respond(LINK, [command(name, number, *params, component=component)], NOW_TIME_NS).frames
    parsed = [m for frame in frames for m in dialect.MAVLink(None).parse_buffer(frame)]
    return [m.result for m in parsed if m.get_type() == "COMMAND_ACK"]


def sender(name: str) -> int:
    return CAMERA_COMPONENT_ID if name in OF_CAMERA else 191


def test_the_list_of_what_we_send_is_complete() -> None:
    out = everything()
    out.notices.add(4, "text")
    numbers = {number for _, number in kinds([*sent(out), *answered(out)])}
    assert numbers == {message_number(name) for name in STREAMS | ON_REQUEST | ANSWERS}
    assert len(ENCODE) == len(STREAMS | ON_REQUEST | ANSWERS | OF_SIMULATORS)


@pytest.mark.parametrize("to", ["its sender", "all"])
@pytest.mark.parametrize("name", sorted(STREAMS))
def test_each_stream_is_sent_on_request_and_its_interval_is_read_and_set(name: str, to: str) -> None:
    component = 0 if to == "all" else None
    answers = 2 if (name, to) == ("HEARTBEAT", "all") else 1  # ours and the camera's
    out = everything()
    sent(out)
    if name not in FIXED:
        assert ask(out, name, SET, -1.0, component=component) == [ACCEPTED]
    assert ask(out, name, REQUEST, component=component) == [ACCEPTED] * answers
    key = sender(name), message_number(name)
    assert kinds(sent(out, NOW_TIME_NS + 1))[key] == (2 if name == "ADSB_VEHICLE" else 1)  # the leader and a track
    assert kinds(sent(out, NOW_TIME_NS + 2))[key] == 0
    assert ask(out, name, GET, component=component) == [ACCEPTED] * answers
    if name in FIXED:
        assert ask(out, name, SET, -1.0, component=component) == [DENIED] * answers
        assert kinds(sent(out, NOW_TIME_NS + 2 * S))[key] == 1
    else:
        assert ask(out, name, SET, 100_000.0, component=component) == [ACCEPTED]
        later = sum((kinds(sent(out, NOW_TIME_NS + S + k * S // 10)) for k in range(1, 11)), Counter())
        # 10 a second; of a track and our own state there is one record, of one time
        assert later[key] == {"ADSB_VEHICLE": 11, "COLLISION": 1, "ODOMETRY": 1}.get(name, 10)


@pytest.mark.parametrize("name", sorted(ON_REQUEST))
def test_what_is_sent_on_request_only_comes_at_once(name: str) -> None:
    frames = everything().respond(LINK, [command(name, REQUEST)], NOW_TIME_NS).frames
    assert kinds(frames) == {(sender(name), 77): 1, (sender(name), message_number(name)): 1}


def test_what_is_in_no_table_is_not_sent() -> None:
    """Neither messages nor commands: 400 arms, 176 sets a mode, 22 takes off."""
    encoder = Encoder(1, 191)
    with pytest.raises(ValueError, match=r"Attitude is not sent: onboard/autopilot/sent\.py does not list it"):
        encoder.encode(Attitude(t_ns=0, t_recv_ns=0, q_nb=(1.0, 0.0, 0.0, 0.0), omega_b=(0.0, 0.0, 0.0)))
    for number in (400, 176, 22):
        with pytest.raises(ValueError, match="Command is not sent"):
            encoder.encode(command_long(number, 1.0))
    assert encoder.encode(command_long(SET, 30.0, 20_000.0))
