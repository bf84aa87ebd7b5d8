"""The health of the pipeline, of what its parts have counted."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard.clocks import Clocks
from onboard.estimators import EstimatorProtocol, counted_verdicts
from onboard.health import Advisor, Monitor, autopilot_name, sender_of, total
from onboard.messages import ComputerLoad, Health, LinkHealth, SinkHealth
from onboard.ownship import Ownship
from onboard.pipeline.admission import Admission
from onboard.units import S_PER_NS
from onboard.wire.datagrams import DatagramDecoder


class Parts(NamedTuple):
    """Parts of a pipeline that have counts for the health."""

    clocks: Clocks
    ownship: Ownship
    admission: Admission
    monitor: Monitor
    decoder: DatagramDecoder
    estimators: Mapping[str, EstimatorProtocol]
    advisor: Advisor


class Rim(NamedTuple):
    """State of the daemon outside its pipeline."""

    sinks: Mapping[str, SinkHealth] = {}
    links: Mapping[str, LinkHealth] = {}
    computer: ComputerLoad = ComputerLoad()
    wall_step_ns: int = 0  # by which the wall clock was set since the start


NO_RIM: Final = Rim()


def health(parts: Parts, t_recv_ns: int, first_recv_ns: int, rim: Rim) -> Health:
    """Return the health at a time of this computer's clock. `first_recv_ns` is the first datagram's arrival."""
    clocks, monitor, offset = parts.clocks, parts.monitor, parts.clocks.offset_ns
    rejected = (monitor.rejected, monitor.errors.counts, clocks.rejected, parts.ownship.rejected)
    record = Health(
        t_ns=t_recv_ns - offset if offset is not None else 0,
        t_recv_ns=t_recv_ns,
        uptime=(t_recv_ns - first_recv_ns) * S_PER_NS,
        autopilot=autopilot_name(parts.admission.autopilot),
        autopilot_reboots=clocks.reboots,
        clock_source=clocks.source,
        clock_offset_ns=offset,
        clock_rate=clocks.rate,
        wall_step_ns=rim.wall_step_ns,
        beside=tuple(map(autopilot_name, parts.admission.beside)),
        beside_ids=tuple(map(sender_of, parts.admission.beside)),
        round_trip=None if clocks.round_trip_ns is None else clocks.round_trip_ns * S_PER_NS,
        streams=monitor.streams(t_recv_ns),
        states=dict(monitor.states),
        verdicts=dict(monitor.verdicts) | counted_verdicts(parts.estimators),
        rejected=total([*rejected, parts.decoder.rejected]),
        own_motion_sources=parts.ownship.source_changes,
        sinks=dict(rim.sinks),
        links=dict(rim.links),
        computer=rim.computer,
        faults=monitor.faults,
        refusals=monitor.refusals.latest,
        followed=sender_of(parts.admission.autopilot),
        senders=monitor.senders,
        needed=dict(parts.advisor.needs.rates),
        cameras=monitor.cameras.health(t_recv_ns),
        reasons={name: why.words for name, why in monitor.reasons.items()},
        causes={name: why.cause for name, why in monitor.reasons.items()},
        consistency=monitor.consistencies.summary(),
    )
    return replace(record, advice=parts.advisor.advise(record))
