"""The senders whose messages count; other senders change nothing."""

from collections.abc import Mapping
from enum import Flag, auto
from typing import Final

from onboard.messages.base import Message
from onboard.messages.camera import Exposure, FieldOfView, GimbalAttitude
from onboard.messages.guidance import FollowTarget
from onboard.messages.parameters import ParamRequest, Ping
from onboard.messages.surveillance import AdsbVehicle, DistanceReading, PeerPosition, PeerRanges, RadarScan
from onboard.messages.vehicle import Command, GlobalPosition, TimeSync


class Sender(Flag):
    """Who may send a message."""

    AUTOPILOT = auto()  # the component whose heartbeat is followed
    COMPONENT = auto()  # another component of its system, or a process on this computer
    PEER = auto()  # another system, where an estimator listens
    ASKER = auto()  # whoever asks something of us: it is answered, and changes no estimate
    VEHICLE = AUTOPILOT | COMPONENT


SENDERS: Final[Mapping[type[Message], Sender]] = {  # any other message counts from the autopilot only
    **dict.fromkeys((Exposure, FieldOfView, GimbalAttitude), Sender.VEHICLE),
    **dict.fromkeys((DistanceReading, RadarScan, PeerRanges), Sender.VEHICLE),
    AdsbVehicle: Sender.VEHICLE | Sender.PEER,  # a ground station's receiver hears aircraft, too
    PeerPosition: Sender.PEER,
    **dict.fromkeys((GlobalPosition, FollowTarget), Sender.AUTOPILOT | Sender.PEER),
    **dict.fromkeys((Command, ParamRequest, Ping, TimeSync), Sender.AUTOPILOT | Sender.ASKER),
}
