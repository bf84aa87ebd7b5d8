"""How an encounter departs from what an estimator supposes of leaders and of our own errors: one assumption that
is false, of a leader or of ourselves. The ranges of `conditions` lie around what is supposed; these lie outside.
Or we sway, to see the leader from elsewhere: that falsifies nothing.
"""

from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from simlink.encounters.conditions import NOMINAL_SIZE, Conditions
from simlink.encounters.curves import Motion, level, moving
from simlink.encounters.families import TURN, Scene
from simlink.world.constants import DT


class Departure(NamedTuple):
    """By default none. The factors are of what a family or its conditions draw: of a multirotor's drag, the
    leader's manoeuvres (`vigour`), the noise of image points, and the errors of our attitude and velocity."""

    drag: float = 1.0
    wind: float | None = None  # m/s, from anywhere; None: a breeze
    any_nose: bool = False  # the leader's nose points anywhere, whatever its course
    size_off: float | None = None  # of the nominal wingspan, to either side; None: SIZE_WITHIN at most
    vigour: float = 1.0
    image_noise: float = 1.0
    own_errors: float = 1.0
    mount_off_deg: float = 0.0  # the camera from where it is configured, about one of its axes
    sway: float = 0.0  # m, to either side, of ourselves across the first line of sight, on top of what we fly


NONE: Final = Departure()


def depart(
    scene: Scene, conditions: Conditions, departure: Departure, rng: np.random.Generator
) -> tuple[Scene, Conditions]:
    """The scene and the conditions after a departure; its `vigour` is that of the family's own draw."""
    d = departure
    turned, windward, side = rng.uniform(0.0, TURN), rng.uniform(0.0, TURN), float(rng.choice([-1.0, 1.0]))
    if d.any_nose:
        scene = scene._replace(nose=scene.nose + turned)
    if d.wind is not None:
        scene = scene._replace(wind=d.wind * level(np.array(windward)))
    if d.sway:
        scene = scene._replace(follower=_swaying(scene, d.sway, rng))
    leader, camera, nav = (getattr(conditions.scenario, part) for part in ("leader", "camera", "nav"))
    if d.size_off is not None:
        leader = replace(leader, size=NOMINAL_SIZE * (1.0 + side * d.size_off))
    errors = {name: getattr(nav, name) for name in ("attitude_deg", "yaw_deg", "velocity")}
    scenario = replace(
        conditions.scenario,
        leader=leader,
        camera=replace(camera, sigma_px=d.image_noise * camera.sigma_px),
        nav=replace(nav, **{name: replace(e, sigma=d.own_errors * e.sigma) for name, e in errors.items()}),
    )
    return scene, Conditions(d.drag * conditions.drag, scenario)


def _swaying(scene: Scene, amplitude: float, rng: np.random.Generator) -> Motion:
    """Our motion with a sway across the first line of sight, of 7 to 12 s."""
    sight = scene.leader.r[0] - scene.follower.r[0]
    across = level(np.arctan2(sight[1], sight[0]) + np.array(0.25 * TURN))
    phase = TURN * (DT * np.arange(len(scene.follower.r)) / rng.uniform(7.0, 12.0) + rng.uniform())
    return moving(scene.follower.r + amplitude * np.sin(phase)[:, None] * across)
