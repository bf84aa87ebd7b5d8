"""Causes in the images: none come, or their stamps, names or noise are wrong."""

import math
from collections.abc import Iterator
from typing import Final

from onboard.health.needs import Moment
from onboard.health.words import FIT
from onboard.messages import Advice, CameraHealth, Clock, Health, Severity
from onboard.messages.causes import Cause
from onboard.messages.stamps import UPTIME, Reading, Span, read_stamps
from onboard.units import NS_PER_S

FIRST_IMAGE_TIMEOUT_S: Final = 5.0  # after the start, before an image is missing
SILENCE_TIMEOUT_S: Final = 2.0
MIN_LATENCY_S: Final = 0.003  # from exposure to the detector's answer; nothing is faster
MAX_LATENCY_S: Final = 0.4  # of 0.5 s, beyond which images are too old
IMPLAUSIBLE_LATENCY_S: Final = 2.0  # no camera is so late: its stamp is of another clock, or in another unit
WIDE_ANGLE: Final = 0.35  # rad off the axis
# Measured noise over the configured one that is named: sound cameras have up to 1.3, with poses 1.6.
MAX_NOISE_RATIO: Final = 1.7
MIN_NOISE_RATIO: Final = 0.5
MIN_JUDGED_COUNT: Final = 10  # images by which a share is judged
LEADERS: Final = ("leader", "oh_johnson")


def silent_camera(m: Moment) -> Iterator[Advice]:
    """No images, or not any more."""
    if not m.needs.images or m.waited < FIRST_IMAGE_TIMEOUT_S:
        return
    if not m.now.cameras:
        yield from _never_heard(m)
    for name, camera in m.now.cameras.items():
        if camera.age > SILENCE_TIMEOUT_S and not _is_refused(m):
            empty = _detector_sends(m, m.since(camera.age))
            why = "its detector sends, but finds no aircraft" if empty else "is its detector running?"
            yield _advice(
                "camera-silent",
                name,
                f"camera {name}: no image for {camera.age:.0f} s; {why}",
                "look at what the detector finds" if empty else f"start it: it sends on {_key(m, name)}",
                f"camera {name}: no images",
                Severity.NOTICE if empty else Severity.ERROR,
                over=f"camera {name}: images come again",
            )


def _never_heard(m: Moment) -> Iterator[Advice]:
    name = m.needs.cameras[0] if m.needs.cameras else "front"
    if _is_refused(m):
        return  # the advice on what is refused says why
    if _detector_sends(m, m.before):
        what = f"camera {name}: something comes, but no aircraft is in it"
        remedy = f"a detector that finds an aircraft sends `detections` on {_key(m, name)}"
    else:
        places = [f"link {k.name} ({k.url})" for k in m.needs.links if not k.is_autopilot]
        what = f"camera {name}: no image has come" + (f", nor on {', '.join(places)}" if places else "")
        remedy = f"start the detector: it sends on {_key(m, name)} (`onboard.client.Camera`)"
    yield _advice(
        "camera-silent", name, what, remedy, f"camera {name}: no images", over=f"camera {name}: images come"
    )


def stamps(m: Moment) -> Iterator[Advice]:
    """Images whose stamps cannot be times of exposure, though they are used."""
    for name, camera in m.now.cameras.items():
        if camera.latency is None or camera.age > SILENCE_TIMEOUT_S or camera.count < MIN_JUDGED_COUNT:
            continue
        if (reading := stamp_reading(m, name, camera)) is not None:
            what = f"camera {name}: `t_ns` is {reading.words}"
            yield _advice("clock", name, what, reading.remedy, f"camera {name}: stamps are of another clock")
            continue
        if camera.latency < MIN_LATENCY_S:
            when = "after" if camera.latency > 0.0 else "before"
            what = (
                f"camera {name}: images arrive {1e3 * abs(camera.latency):.0f} ms {when} the time of their stamp; "
                "a camera and a detector take 20 ms and more, so it is not that of exposure"
            )
            remedy = f"stamp the exposure, or set `delay_s` of {section_of(m, name)}; {of_camera(m, name, FIT)}"
        elif camera.latency > MAX_LATENCY_S:
            what = f"camera {name}: images arrive {camera.latency:.2f} s after exposure; at 0.5 s they are too old"
            remedy = "make the detector faster, or let it leave images out; is `t_ns` the time of exposure?"
        else:
            continue
        yield _advice("stamps", name, what, remedy, f"camera {name}: stamps are off", Severity.WARNING)


def stamp_reading(m: Moment, name: str, camera: CameraHealth) -> Reading | None:
    """Return what the newest stamp of a camera is, if it is not what it says."""
    offset_ns, stamp_ns, late_s = m.now.clock_offset_ns, camera.stamp_ns, camera.latency
    if (
        offset_ns is None
        or stamp_ns is None
        or late_s is None
        or abs(late_s) < IMPLAUSIBLE_LATENCY_S
        or camera.age > SILENCE_TIMEOUT_S
    ):
        return None
    arrived_ns = m.now.t_recv_ns - round(camera.age * NS_PER_S)
    boot_ns = arrived_ns - offset_ns
    spans = {Clock.HOST: Span(arrived_ns, arrived_ns), Clock.BOOT: Span(boot_ns, boot_ns)}
    up_ns = round(((m.now.computer.uptime or 0.0) - camera.age) * NS_PER_S)
    if up_ns > 0 and Span(up_ns, up_ns).contains([stamp_ns]) and not spans[Clock.BOOT].contains([stamp_ns]):
        return UPTIME
    return read_stamps([stamp_ns], Clock(camera.clock), spans, is_ros=name in m.needs.ros)


def lens(m: Moment) -> Iterator[Advice]:
    """Points far from the optical axis of a camera without distortion: pixels of a real lens are off there."""
    for name, camera in m.now.cameras.items():
        if name in m.needs.undistorted and camera.off_axis > WIDE_ANGLE and camera.count >= MIN_JUDGED_COUNT:
            yield _advice(
                "lens",
                name,
                f"camera {name}: points are {math.degrees(camera.off_axis):.0f} degrees off the axis, and no "
                "distortion is configured: there a wide lens moves pixels by a tenth",
                f"set `distortion` or `calibration` of {section_of(m, name)}, unless pixels are undistorted "
                "already",
                f"camera {name}: lens distortion not set",
                Severity.NOTICE,
            )


def names(m: Moment) -> Iterator[Advice]:
    """Targets that are not the leader, and classes without a section."""
    for name, camera in m.now.cameras.items():
        if camera.age > SILENCE_TIMEOUT_S:
            continue
        unknown = [c for c in camera.classes if m.needs.classes and c not in m.needs.classes]
        if unknown:
            yield _advice(
                "class",
                name,
                f"camera {name}: class `{unknown[-1]}` has no section; wingspan as in [estimator.leader]",
                f"add [target.{unknown[-1]}] with `size_prior_m`, or send one of {', '.join(m.needs.classes)}",
                f"class {unknown[-1]} is not known",
                Severity.WARNING,
            )
        others = [target for target in camera.targets if target not in ("leader", "")]
        if others and len(others) == len(camera.targets) and _leader_is_lost(m):
            yield _advice(
                "target",
                name,
                f"camera {name}: its images are of target `{others[-1]}`, none of `leader`",
                f"let the detector send `target: leader`, or none; or read `estimate/leader/{others[-1]}`",
                f"no images of target leader, of {others[-1]}",
            )


def noise(m: Moment) -> Iterator[Advice]:
    """Images that scatter from one to the next by more, or by less, than their noise allows."""
    for name in m.now.cameras:
        for estimator in LEADERS:
            found = m.now.consistency.get(f"{estimator}.{name}")
            is_quiet = found is not None and found.noise < MIN_NOISE_RATIO and found.nis <= found.high
            if found is None or not (found.noise > MAX_NOISE_RATIO or is_quiet):
                continue
            scale = f"{found.noise:.1f} times"
            gain = ", which makes estimates surer" if is_quiet else ""
            yield _advice(
                "noise",
                name,
                f"camera {name}: the images scatter {scale} as much as the configured noise explains, "
                f"NIS {found.nis:.1f} times the expected one (bounds {found.low:.2f} to {found.high:.2f})",
                f"set `sigma_px` of {section_of(m, name)} to {scale} its value{gain}",
                f"images scatter {scale} as much as set",
                Severity.NOTICE if is_quiet else Severity.WARNING,
            )


def _leader_is_lost(m: Moment) -> bool:
    return not any(m.now.states[e].is_valid for e in LEADERS if e in m.now.states)


def _detector_sends(m: Moment, since: Health) -> bool:
    """Whether anything has come where detections come, since an earlier health."""
    names = {k.name for k in m.needs.links if not k.is_autopilot} | {"zenoh"}
    before = since.links
    return any(
        h.received > before[name].received for name, h in m.now.links.items() if name in names and name in before
    )


def _is_refused(m: Moment) -> bool:
    """Whether images come, but are refused: that has advice of its own. Of what no camera's name is known, the
    source is the link, the Zenoh key or the ROS topic."""
    links = {k.name for k in m.needs.links if not k.is_autopilot}
    return any(
        (r.source.startswith("camera ") or "/" in r.source or r.source in links or r.cause is Cause.OTHER_CLOCK)
        and m.now.t_recv_ns - r.t_recv_ns < SILENCE_TIMEOUT_S * NS_PER_S
        for r in m.now.refusals
    )


def _key(m: Moment, name: str) -> str:
    return f"`{m.needs.prefix}/camera/{name}/detections`" if m.needs.prefix else "a `json:` link"


def of_camera(m: Moment, name: str, remedy: str) -> str:
    """A remedy for the first camera, as one for a camera of this name."""
    if name not in m.needs.cameras[1:]:
        return remedy
    remedy = remedy.replace("[camera]", section_of(m, name))
    return remedy.replace("onboard calibrate LOG", f"onboard calibrate LOG --camera {name}")


def section_of(m: Moment, name: str) -> str:
    """The section of a camera in the configuration."""
    return f"[cameras.{name}]" if name in m.needs.cameras[1:] else "[camera]"


def _advice(
    cause: str,
    camera: str,
    what: str,
    remedy: str,
    text: str,
    severity: Severity = Severity.ERROR,
    over: str = "",
) -> Advice:
    return Advice(
        kind=cause, severity=severity, about=f"camera {camera}", what=what, remedy=remedy, text=text, over=over
    )
