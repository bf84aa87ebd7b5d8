"""Causes in the messages of our own vehicle."""

from collections.abc import Iterator
from typing import Final

from onboard.health.needs import MOTION_STREAMS, RATE_SHARE, SILENCE_TIMEOUT_S, LinkNeed, Moment
from onboard.messages import Advice, Severity

CLOCK_TIMEOUT_S: Final = 15.0
FIRST_SAMPLE_TIMEOUT_S: Final = 5.0  # after the start, before a stream is missing
MAX_ROUND_TRIP_TIME_S: Final = 0.05
MAX_OWN_NIS_RATIO: Final = 3.0  # to its expectation: above manoeuvres, and noise of half as much again
# By record: the MAVLink message that is asked for, ArduPilot's parameter of its rate, and what fails without it.
STREAMS: Final = {
    "Attitude": ("ATTITUDE_QUATERNION", "EXTRA1", "each image needs our attitude at its exposure"),
    "LocalPosition": ("LOCAL_POSITION_NED", "POSITION", "without our velocity nothing can be predicted"),
    "Imu": ("HIGHRES_IMU", "RAW_SENS", "a wrong heading and a weak motor are not noticed"),
    "GpsFix": ("GPS_RAW_INT", "EXT_STAT", "our own state has no position"),
}


def silent_autopilot(m: Moment) -> Iterator[Advice]:
    """No autopilot, or not any more, or none of the configured system."""
    if m.is_heard or m.waited < SILENCE_TIMEOUT_S:
        return
    links = [link for link in m.needs.links if link.is_autopilot]
    if m.now.followed:
        yield _error(
            "autopilot-silent",
            "the autopilot is silent: no estimates" + f" (for {m.silence:.0f} s)",
            f"check the cable, or the router, of {_link_names(links)}",
            "autopilot silent: no estimates",
            "the autopilot is heard again",
        )
    elif m.now.beside and m.needs.system:
        heard = m.now.beside_ids[0].partition("/")[0]
        yield _error(
            "system",
            f"no autopilot of system {m.needs.system} is heard, as `autopilot.system` wants; heard: "
            + "; ".join(m.now.beside),
            f"set `system = {heard}` in [autopilot], or leave it out",
            f"no autopilot of system {m.needs.system}, but {heard}",
        )
    elif not _is_refused(m):
        yield from _nothing_heard(m, links)


def _nothing_heard(m: Moment, links: list[LinkNeed]) -> Iterator[Advice]:
    received = sum(health.received for name, health in m.now.links.items() if name in [k.name for k in links])
    if received:
        what = f"{received} datagrams came, but no heartbeat of an autopilot"
        remedy = "a serial port: set its baud rate in `url`; a router: let it pass HEARTBEAT of the autopilot"
    else:
        what = "nothing has come from an autopilot" + "".join(f"; link {k.name} is {k.url}" for k in links)
        remedy = (
            "; ".join(dict.fromkeys(_connection_remedy(link.url) for link in links))
            or "add a [[link]] to an autopilot"
        )
    yield _error("autopilot-silent", what, remedy, "no autopilot heard")


def _connection_remedy(url: str) -> str:
    """Return how to make an autopilot send to a link."""
    kind, _, where = url.partition(":")
    if kind == "udpin":
        port = where.rpartition(":")[2]
        return f"let it send there, as `mavproxy.py --out=udpout:127.0.0.1:{port}`, or set `url` of the [[link]]"
    if kind == "serial":
        return "ArduPilot: `param set SERIAL2_PROTOCOL 2`; PX4: `param set MAV_1_CONFIG 102`; check TX and RX"
    return "start what listens there, or set `url` of the [[link]]"


def other_vehicles(m: Moment) -> Iterator[Advice]:
    """Other autopilots that are heard, any of which may be the wanted one."""
    if not m.now.followed:
        return
    for name in m.now.beside:
        yield Advice(
            kind="system",
            severity=Severity.NOTICE,
            about=name,
            what=f"also heard: {name}; followed is {m.now.autopilot}",
            remedy="`autopilot.system` chooses",
            text=f"also heard: {name}",
        )


def missing_streams(m: Moment) -> Iterator[Advice]:
    """A stream that an estimator needs is not there, is too slow, or comes of another component."""
    if not m.is_heard or m.has_just_come:
        return
    for name, needed in m.needs.rates.items():
        rate = m.rate(name)
        if rate >= RATE_SHARE * needed:
            continue
        message, parameter, loss = STREAMS[name]
        severity = Severity.ERROR if name in MOTION_STREAMS and rate < 1.0 else Severity.WARNING
        asked = m.needs.asked.get(message, needed)
        if rate == 0.0 and m.rejected("other_component"):
            others = [s for s in m.now.senders if _is_beside(s, m.now.followed)]
            yield _error(
                "component",
                f"no {message} of the autopilot, component {m.now.followed.partition('/')[2]}: another component "
                f"sends motion, which is not used (heard, as system/component: {', '.join(others)})",
                "let the component whose heartbeat is the autopilot's send it: "
                + _stream_line(m, message, parameter, asked),
                f"no {message} of the autopilot itself",
            )
            continue
        if name == "LocalPosition" and rate == 0.0 and m.rate("Attitude") > 0.0:
            yield _error(
                "position",
                f"{message} does not come: the autopilot has no position yet (its filter aligns, or no GPS)",
                f"wait, in simulation 40 s; if it has one: {_stream_line(m, message, parameter, asked)}",
                "no position yet: filter aligns, or no GPS",
                f"{message} comes",
            )
            continue
        came = "does not come" if rate == 0.0 else f"comes at {rate:.1f} Hz"
        yield Advice(
            kind="attitude" if name == "Attitude" and rate == 0.0 else "stream",
            severity=severity,
            about=message,
            what=f"{message} {came}; needed are {needed:g} Hz: {loss}",
            remedy=_stream_line(m, message, parameter, asked),
            text=f"{message}: {rate:.0f} Hz of {needed:g}",
            over=f"{message} comes",
        )


def no_origin(m: Moment) -> Iterator[Advice]:
    """Places on Earth are to be sent, and the autopilot has no origin."""
    if not m.needs.sends_places or not m.is_heard or m.waited < FIRST_SAMPLE_TIMEOUT_S:
        return
    if "GlobalOrigin" not in m.now.streams and "GlobalPosition" not in m.now.streams:
        yield Advice(
            kind="origin",
            severity=Severity.WARNING,
            about="origin",
            what="the autopilot has no origin (GPS_GLOBAL_ORIGIN) and no global position: the leader's place on "
            f"Earth is not known, and nothing is sent on {', '.join(m.needs.sends_places)}",
            remedy="wait for its GPS, or set the origin: MAVProxy: `wp sethome`, or SET_GPS_GLOBAL_ORIGIN",
            text="no origin: leader not sent",
            over="the autopilot has an origin",
        )


def clock(m: Moment) -> Iterator[Advice]:
    """The two clocks are compared badly, or not at all."""
    if not m.is_heard or m.waited < CLOCK_TIMEOUT_S or not any(k.is_autopilot for k in m.needs.links):
        return
    if m.now.round_trip is None:
        what = "the autopilot answers no TIMESYNC: the clocks are compared by arrivals, which are late by the link"
        remedy = (
            "does it get what we send? TX wire, router, or `key_file` of the [[link]] where it wants signed frames"
        )
    elif m.now.round_trip > MAX_ROUND_TRIP_TIME_S:
        trip = 1e3 * m.now.round_trip
        what = f"the round trip to the autopilot is {trip:.0f} ms: clocks are compared to half of it"
        remedy = "use a faster link, or a higher baud rate, in `url` of the [[link]]"
    else:
        return
    yield Advice(
        kind="timesync",
        severity=Severity.NOTICE,
        about="clock",
        what=what,
        remedy=remedy,
        text="clock of the autopilot known badly",
    )


def own_transponder(m: Moment) -> Iterator[Advice]:
    """Our own transponder is heard, and its address not configured."""
    if m.needs.transponder or not m.verdicts("traffic.ourselves"):
        return
    yield Advice(
        kind="transponder",
        severity=Severity.NOTICE,
        about="own transponder",
        what="reports of a transponder that flies where we are, as we do, are taken for our own, and not tracked",
        remedy="set `own_icao` of [estimator.traffic] to the address of our own transponder",
        text="own transponder heard: set own_icao",
    )


def own_misfit(m: Moment) -> Iterator[Advice]:
    """Measurements of our own motion that do not fit the others, with or without an airframe."""
    for key, found in m.now.consistency.items():
        estimator, _, sensor = key.partition(".")
        if estimator == "own_state" and found.nis > MAX_OWN_NIS_RATIO:
            yield Advice(
                kind="own-misfit",
                severity=Severity.WARNING,
                about=f"own {sensor}",
                what=f"our own {sensor} does not fit our other sensors: NIS {found.nis:.1f} times the expected "
                f"one (bounds {found.low:.2f} to {found.high:.2f}); the vehicle or a sensor is at fault",
                remedy="look for a second vehicle with this system id, vibration, a loose or shaded antenna, a "
                "compass near currents; "
                "`onboard report LOG` shows what contradicts what",
                text=f"own {sensor} does not fit the others",
                over=f"own {sensor} fits again",
            )


def _stream_line(m: Moment, message: str, parameter: str, rate: float) -> str:
    """Return the command that sets a stream's rate in the autopilot."""
    px4 = f"`mavlink stream -d DEVICE -s {message} -r {rate:g}`"
    ardupilot = f"`param set SR1_{parameter} {rate:g}` (4.7: MAV2_{parameter})"
    if m.now.autopilot.startswith("PX4"):
        return px4
    if m.now.autopilot.startswith("ArduPilot"):
        return ardupilot
    return f"ArduPilot: {ardupilot}; PX4: {px4}"


def _is_beside(sender: str, followed: str) -> bool:
    """Whether a sender is another component of the autopilot's system."""
    return sender != followed and sender.partition("/")[0] == followed.partition("/")[0]


def _is_refused(m: Moment) -> bool:
    """Whether frames come, but are refused: their own advice says why."""
    return any(m.rejected(reason) for reason in ("unsigned", "forged", "signed_ahead", "replayed"))


def _link_names(links: list[LinkNeed]) -> str:
    return ", ".join(f"link {link.name} ({link.url})" for link in links) or "the link"


def _error(cause: str, what: str, remedy: str, text: str, over: str = "") -> Advice:
    return Advice(
        kind=cause, severity=Severity.ERROR, about="autopilot", what=what, remedy=remedy, text=text, over=over
    )
