"""`onboard calibrate`: a camera's delay, mount and focal length from one flight behind a leader that flies calmly,
with the estimator that a flight's advice uses (`onboard.health.camera_errors`) and longer windows."""

import argparse
import math
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from onboard import UserError
from onboard.analysis.flights.replay import aligned, check_log, flight_of
from onboard.arrays import Array
from onboard.commands.calibrate_airframe import calibrate_airframe
from onboard.config import Config, load_config
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion, matrix_from_euler, quaternion_from_matrix
from onboard.health.camera_errors import DELAY, FOCAL, ZERO_ERROR, Poses, Sights, Window, finished, fitting
from onboard.messages import Exposure, OwnPose, TargetPoints
from onboard.terminal.files import check_targets
from onboard.terminal.output import show
from onboard.units import S_PER_NS

KNOWN_WELL: Final = {"delay_s": 0.02, "mount_deg": 0.5, "focal": 0.02}  # sigmas: one known worse is not offered
LARGEST_DEG, LARGEST_S = 20.0, 0.4  # of a correction; a larger one is rather the leader's own motion
WIDTH, HEIGHT, MARGIN = 900, 260, 40  # of a panel of the picture, px
PICTURE_SIGMAS: Final = 5.0  # sigmas: the picture's scale
LEADER: Final = ("leader", "")  # ids of its images
WINDOW_S: Final = 8.0
MIN_IMAGE_COUNT: Final = 100  # images
FEWEST_OF_WINDOW: Final = 20
MOST_IMAGES: Final = 1500  # images: of more, every second, third ...


class Images(NamedTuple):
    """Images of the leader by the configured camera: times (k,) s, centers (k, 2), apparent wings (k,), in focal
    lengths, and the centers' standard deviations (k,)."""

    t: Array
    center: Array
    span: Array
    sigma: Array


class Calibration(NamedTuple):
    """Corrections to the configuration, and their standard deviations: the delay in s, the mount as a rotation
    vector (3,) in rad about the camera's axes, the factor of the focal length. `before` and `after` (k, 2):
    residuals in sigmas as configured and corrected, of images at `t` (k,) s."""

    t: Array
    delay: float
    delay_sigma: float
    mount: Array
    mount_sigma: Array
    focal: float
    focal_sigma: float
    before: Array
    after: Array


def main(arguments: argparse.Namespace) -> int:
    """Print the corrections with their sigmas, and the lines to paste; draw the residuals. Raises UserError."""
    check_log(arguments.log)
    check_targets(arguments.svg, inputs=(arguments.log,))
    config = load_config(arguments.config or flight_of(arguments.log).config, tuple(arguments.set))
    if arguments.mass is not None:
        for line in calibrate_airframe(arguments, config):
            show(line)
        return 0
    camera = config.camera_model()
    if arguments.camera is not None:
        camera = camera.named(arguments.camera)
        if camera.name != arguments.camera:
            raise UserError(f"no camera {arguments.camera}: `--camera` is {' or '.join(config.camera_inputs())}")
    images, own = collect(arguments.log, config, camera)
    leader = config.estimator.get("leader")
    if leader is None:
        raise UserError("calibrate needs [estimator.leader]: the leader's size_prior_m")
    found = calibrate(images, own, camera, leader.size_prior_m)
    for line in described(found, config, camera):
        show(line)
    if arguments.svg is not None:
        arguments.svg.write_text(picture(found), encoding="utf-8")
        show(f"written: {arguments.svg}")
    return 0


def collect(log: Path, config: Config, camera: Camera) -> tuple[Images, Poses]:
    """A camera's images of the leader with all three points, at their time on the boot clock less the
    configured delay, and our own motion. Raises UserError."""
    poses: list[OwnPose] = []
    images: list[TargetPoints] = []
    if camera.gimbal is not None:
        raise UserError(f"camera {camera.name} is on a gimbal: calibrate it held still, without `gimbal`")
    named = config.camera_model().named
    for item in aligned(log, config, lambda m: isinstance(m, Exposure) and named(m.camera).name == camera.name):
        if isinstance(item, OwnPose):
            poses += [item] if item.r_OF_n[0] is not None else []
        elif isinstance(item, Exposure) and (of_leader := _of_leader(item)):
            if item.detections[0].mount is not None:
                raise UserError(f"{log}: images with `attitude`: calibrate the camera held still")
            images += of_leader
    if len(poses) < 2 or not images:
        raise UserError(
            f"{log}: {len(images)} images of a leader and {len(poses)} own poses: nothing to calibrate with"
        )
    return _images(images[:: 1 + len(images) // MOST_IMAGES], camera.sigma), _own(poses)


def _of_leader(exposure: Exposure) -> list[TargetPoints]:
    """Its images of the leader with all three points."""
    return [m for m in exposure.detections if isinstance(m, TargetPoints) and m.target in LEADER]


def _images(images: list[TargetPoints], sigma: float) -> Images:
    images = sorted(images, key=lambda m: m.t_ns)
    sigmas = [m.sigma[0] if m.sigma is not None else sigma for m in images]
    return Images(
        np.array([m.t_ns * S_PER_NS for m in images]),
        np.array([m.center for m in images]),
        np.array([math.dist(m.left, m.right) for m in images]),
        np.array(sigmas),
    )


def _own(poses: list[OwnPose]) -> Poses:
    """Our own motion."""
    poses = list({pose.t_ns: pose for pose in sorted(poses, key=lambda p: p.t_ns)}.values())
    columns = [p.t_ns * S_PER_NS for p in poses], [p.r_OF_n for p in poses], [p.q_nb for p in poses]
    return Poses(*(np.array(column, float) for column in columns))


def calibrate(images: Images, own: Poses, camera: Camera, size: float) -> Calibration:
    """The corrections of a camera that fit one flight best. `size`: the leader's wingspan, m.

    Raises UserError for a flight with too few images.
    """
    inside = (images.t > own.t[0] + 1.0) & (images.t < own.t[-1] - 1.0)
    images = Images(*(array[inside] for array in images))
    windows = _windows(images, own, camera, size)
    if len(images.t) < MIN_IMAGE_COUNT or not windows:
        raise UserError(f"{len(images.t)} images with our own pose: at least {MIN_IMAGE_COUNT} are needed")
    sigma = float(np.median(images.sigma))
    found = finished(fitting(windows))
    errors, sigmas, focal = found.errors, found.sigma, math.exp(found.errors[FOCAL])
    return Calibration(
        np.concatenate([window.t for window in windows]),
        float(errors[DELAY]),
        float(sigmas[DELAY]),
        errors[1:4],
        sigmas[1:4],
        focal,
        focal * float(sigmas[FOCAL]),
        _residuals(windows, ZERO_ERROR, sigma),
        _residuals(windows, errors, sigma),
    )


def _windows(images: Images, own: Poses, camera: Camera, size: float) -> list[Window]:
    """The flight in windows; in each the distance changes evenly, as the wing's apparent length does."""
    found = []
    which = ((images.t - images.t[:1]) / WINDOW_S).astype(int)
    for n in range(int(which[-1]) + 1 if len(which) else 0):
        t, center, span, _ = (array[which == n] for array in images)
        if len(t) < FEWEST_OF_WINDOW:
            continue
        line = np.polynomial.Polynomial.fit(t, np.log(span), 1)
        found.append(Window(Sights(t, center, size / np.exp(line(t))), own, camera))
    return found


def _residuals(windows: list[Window], errors: Array, sigma: float) -> Array:
    """Residuals (k, 2) to the right and down, in sigmas, with these errors of the camera."""
    normals = [w.normal(errors) for w in windows]
    in_c = [np.einsum("kji,kj->ki", n.R_nc, n.residuals) for n in normals]
    return np.vstack(in_c)[:, 1:] / sigma


def described(found: Calibration, config: Config, camera: Camera) -> list[str]:
    """Lines for a person: a camera's corrections with sigmas, then the configuration to paste."""
    angles, sigmas = np.degrees(found.mount), np.degrees(found.mount_sigma)
    lines = [
        f"delay          {found.delay * 1e3:+8.1f} ms  +- {found.delay_sigma * 1e3:.1f}",
        *(
            f"mount {axis:8} {angle:+8.2f} deg +- {sigma:.2f}"
            for axis, angle, sigma in zip(("roll", "pitch", "yaw"), angles, sigmas, strict=True)
        ),
        f"focal length   {100 * (found.focal - 1):+8.2f} %   +- {100 * found.focal_sigma:.2f}",
        f"residuals      {_rms(found.before):.2f} sigmas as configured, {_rms(found.after):.2f} corrected",
    ]
    if np.abs(angles).max() > LARGEST_DEG or abs(found.delay) > LARGEST_S:
        return [
            *lines,
            "not to be trusted: so large an error is rather the leader's own motion; nothing is offered",
        ]
    is_first = camera.name not in config.cameras
    pasted = ["", "[camera]" if is_first else f"[cameras.{camera.name}]"]
    c = config.camera if is_first else config.cameras[camera.name]
    if found.delay_sigma < KNOWN_WELL["delay_s"]:
        before = c.delay_s if c.delay_s is not None else config.delay.camera_s or 0.0
        pasted.append(f"delay_s = {before + found.delay:.4f}")
    if sigmas.max() < KNOWN_WELL["mount_deg"]:
        R_bc = camera.R_bc @ matrix_from_euler(*found.mount)
        rpy = np.degrees(euler_from_quaternion(quaternion_from_matrix(R_bc)))
        pasted.append(f"mount_rpy_deg = [{', '.join(f'{angle:.2f}' for angle in rpy)}]")
    if found.focal_sigma < KNOWN_WELL["focal"] and c.calibration is None:
        pasted.append(f"f_px = {c.f_px * found.focal:.1f}")
        if c.fy_px is not None:
            pasted.append(f"fy_px = {c.fy_px * found.focal:.1f}")
    if len(pasted) < 5 + (c.fy_px is not None) - (c.calibration is not None):
        lines.append("what is missing is not known well enough: turn, roll and pitch more, behind a calm leader")
    return lines + (pasted if len(pasted) > 2 else [])


def _rms(residuals: Array) -> float:
    return float(np.sqrt(np.mean(np.square(residuals))))


def picture(found: Calibration) -> str:
    """The residuals of right and down over time, in sigmas, as configured (grey) and corrected (blue): SVG."""
    t = found.t
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{2 * HEIGHT}" font-family="sans-serif">'
    ]
    for i, name in enumerate(("right", "down")):
        top = i * HEIGHT
        parts.append(f'<text x="{MARGIN}" y="{top + 20}">{name}: residual, sigmas (grey: as configured)</text>')
        for level in (-3, 0, 3):
            y = _y(level, top)
            parts.append(f'<line x1="{MARGIN}" x2="{WIDTH}" y1="{y}" y2="{y}" stroke="#ccc"/>')
            parts.append(f'<text x="10" y="{y + 4}" font-size="12">{level:+d}</text>')
        for residuals, colour in ((found.before, "#999"), (found.after, "#2060c0")):
            x = MARGIN + (WIDTH - MARGIN) * (t - t[0]) / max(t[-1] - t[0], 1e-9)
            parts += [
                f'<circle cx="{a:.1f}" cy="{_y(b, top):.1f}" r="1.5" fill="{colour}"/>'
                for a, b in zip(x.tolist(), residuals[:, i].tolist(), strict=True)
            ]
    return "\n".join([*parts, "</svg>\n"])


def _y(value: float, top: int) -> float:
    return top + HEIGHT / 2 - min(max(value, -PICTURE_SIGMAS), PICTURE_SIGMAS) / PICTURE_SIGMAS * (HEIGHT / 2 - 30)
