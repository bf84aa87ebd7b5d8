"""The numbers that the leader's filter believes, and why: how a leader flies (`LeaderModel`), and below that how
aircraft look, how detectors and our own state err, and the wind.

How a measurement is gated and weighed stands with the code that does it (`hypotheses.update`). So do the speeds at
which compiled arithmetic changes from one case to another (`hypotheses.motion`, `hypotheses.prediction`): machine
code is made anew only when its own file changes.

Plain numbers: reading a configuration imports neither NumPy nor Numba.
"""

import math
from typing import Final, NamedTuple

PARTICLES: Final = 900  # hypotheses at most


class Size(NamedTuple):
    """The wingspan and its standard deviation, m."""

    value: float
    sigma: float


class LeaderModel(NamedTuple):
    """What the particles assumes: how a leader of unknown heading flies, and our own errors.

    Values are standard deviations, unless they are named otherwise. A `_random_walk` is a process noise density:
    the state's variance grows by its square each second. A state with a `_time` is a Gauss-Markov process with
    that correlation time. A `_for` is a mean duration. Speeds, accelerations and banks are those of a leader at
    the largest possible range, and proportionally less for nearer ones.

    The reasons: a copter tilted by 0.12 / s of its airspeed at 6 m/s and 0.22 / s at 12 m/s
    (../shared/data/formation-copter); small racers tilt by 0.03 / s, heavy lifters by 0.5 / s; winds of 3 m/s
    along an axis are a gentle breeze. The heading wobbles by 2 degrees in the reference flight of Oh & Johnson.
    The copter's is 4 degrees (RMS) off its course at more than 3 m/s: 5 to one side or the other in its circles.
    Errors of our velocity last some seconds (a receiver's noise, filtered) to a minute (multipath): 20 s.
    Other leaders, flown by hand or fast, differ by large factors: headings 13 to 28 degrees off the course and
    turned at 0.8 rad/s (quadrotors), 3 rad/s (racers); 0.23 to 0.57 m/s in a hover. So each hypothesis has its own
    three factors (`intensity`), wide enough for all of these.
    `evidence_rate` is there because errors of images and of flight are correlated over some tenths of a second,
    and those of what a hypothesis supposes as long as the view stays the same: so new views count (`new_view`),
    and of the same view few images. It, `tied`, `wing scale error`, `bank` and the doubt were chosen on
    encounters, simulated and with recorded leaders: no measurement stands behind them."""

    size: float  # m, the value itself
    size_sigma: float  # m
    misalignment: tuple[float, float, float]  # rad, of our attitude, in n
    misalignment_time: float  # s
    own_velocity: float  # m/s, of our velocity
    own_velocity_time: float = 20.0  # s
    crab: float = 0.0  # rad, of the heading about the course, of a fixed wing; 0: the heading may point anywhere
    heading: float = math.radians(5.0)  # rad, of the heading about our own course, of one that flies along with us
    on_course: float = 0.3  # the prior probability that it does, if we fly
    nose_about_course: float = math.radians(
        5.0
    )  # rad, of a heading that is locked to its course, or a fixed wing's
    air: tuple[float, float] = (0.0, 0.0)  # m/s, velocity to north and east of the air that a course is through
    air_sigma: float = 0.0  # m/s, on each axis
    particles: int = PARTICLES
    speed: float = 8.0  # m/s, relative to us, at first
    acceleration: float = 1.5  # m/s^2, at first
    acceleration_time: float = 4.0  # s
    velocity_random_walk: float = 0.03  # m/s / sqrt(s)
    acceleration_random_walk: tuple[float, float] = (0.6, 3.0)  # m/s^2 / sqrt(s): steady, accelerating
    accelerating: float = 0.25  # the probability that a leader accelerates at first
    steady_for: float = 10.0  # s
    accelerates_for: float = 3.0  # s
    hovering: float = 0.4  # the probability that a multirotor hovers at first
    flies_for: float = 20.0  # s, of a slow one until it hovers
    hovers_for: float = 8.0  # s
    hover_speed: float = 0.2  # m/s, of one that hovers, about its place
    hover_time: float = 1.5  # s
    hover_acceleration: float = 0.16  # m/s^2
    hover_acceleration_time: float = 0.05  # s
    intensity: tuple[float, float, float] = (0.8, 0.5, 0.8)  # of the logarithms: manoeuvres, bank, heading
    intensity_time: float = 200.0  # s, over which a leader changes them
    slack_time: float = 4.0  # s, over which a tied heading changes its angle to the course
    tied: float = 0.5  # the probability that the heading of a leader that flies fast is locked to its course
    tied_for: float = 30.0  # s, until that is decided anew
    undecided_for: float = 2.0  # s, of a fast one
    fewest: int = 80  # particles: as many as the headings and ranges in question need, but so many at least
    fewest_sided: int = 400  # where points show the heading
    still_for: float = 30.0  # s, of a heading, beside the turn of its course, ...
    turns_for: float = 4.0  # s, ... which then turns; a restless heading turns more often and for shorter
    nose_rate: float = 0.2  # rad/s, of a heading that is turned
    nose_random_walk: float = math.radians(0.7)  # rad / sqrt(s)
    bank: float = math.radians(5.0)  # rad, about the bank of its thrust
    bank_time: float = 1.0  # s
    rolled: float = math.radians(3.0)  # rad, of the mean of that error over `rolled_time`
    rolled_time: float = 5.0  # s
    stretch: float = 0.02  # of the apparent length: a tip that is misplaced
    nose_wobble: float = math.radians(2.0)  # rad: it stretches a wing the more, the less is seen of it
    stretch_time: float = 3.0  # s, of both
    drag: float = 0.16  # 1/s, the mean: deceleration by the air, per m/s of airspeed
    drag_sigma: float = 0.08  # 1/s, of a lognormal distribution
    wind: float = 3.0  # m/s, along each axis
    lean_random_walk: float = 0.05  # m/s^2 / sqrt(s)
    evidence_rate: float = 1.5  # 1/s: at most so many images a second count as independent
    first_evidence: float = 8.0  # so many images of a new track count, whatever the view does
    steady_evidence: float = 0.15  # 1/s: so many while the view stays the same
    new_view: float = 0.12  # rad, or share of the range: so much another view is one image more
    doubted_after: float = 8.0  # s, the mean time after which a particle takes another heading
    resample: float = 0.35  # of the particles: with fewer effective ones they are drawn anew
    gate: float = 25.0  # NIS above which no Gaussian expected an image


# Of aircraft, in b (FRD) for a wingspan of 1.
# A box also bounds what has no name. Small aircraft are about as long as three quarters of their span; fuselages
# are a tenth of it high.
FUSELAGE: Final = ((0.36, 0.0, 0.0), (-0.4, 0.0, 0.0))
THICKNESS: Final = ((0.0, 0.0, -0.07), (0.0, 0.0, 0.05))
ROTOR: Final = 0.8  # radius of a rotor, of half the distance to its neighbour: 0.7 to 1 by data sheets
ROTORS_AT: Final = -0.04  # how high they are
ROTORS_HIGH: Final = ((0.0, 0.0, -0.09), (0.0, 0.0, 0.19))  # canopy and feet ...
ROTORS_HEIGHT: Final = 0.08  # ... of which each data sheet has its own: one standard deviation of top and bottom
PITCH: Final = math.radians(7.0)  # rad, of the fuselage about the pitch that thrust implies

# Of detectors: points, boxes, and poses.
MISPLACED: Final = 0.03  # of the wingspan: how far a detector misplaces a point of an aircraft
BOX_SHARE: Final = 0.05  # of the box's larger side: what a detector says of each side is no less
BOX_BIAS: Final = 0.08  # of its size: a detector's boxes are all too wide, or all too narrow ...
GUESS_BIAS: Final = 0.15  # ... and of a wing in usual proportions, so is what they bound
OFF_WING: Final = 0.1  # of the wing: the center from the wing's middle, where nothing is known of it
ON_WING: Final = 0.02  # the same with `center_on_wing`, which allows 1 %; the nearer half of a wing looks longer
OFF_BOX: Final = 0.1  # of the box's side: the center from the box's middle
BIAS_COUNTS: Final = 4.0  # times: a filter averages some sixteen images
TURN_BIAS: Final = math.radians(2.0)  # rad, of a marker that is mounted askew, or a model that is
LEAST_RANGE_SIGMA: Final = 0.002  # of the range: no detector is more exact
FLIPPED: Final = 0.2  # the probability that a rotation is the mirror image ...
STRAY: Final = 0.02  # ... and that it says nothing

# Of a fixed wing, and of the wind.
CRAB: Final = math.radians(14.0)  # rad, of a fixed wing's heading: wind of a quarter of its speed, at one sigma
SLIP: Final = math.radians(3.0)  # rad, of a fixed wing's heading about its path through the air
STRONGEST: Final = 60.0  # m/s: a stronger one is no wind
# m/s on each axis. Of a report without one: the filters of autopilots end between 0.5 and 2, before turns above.
USUAL_SIGMA: Final = 1.5
# A gust of a third of a breeze of 3 m/s: what we feel is not what the leader feels.
GUST: Final = 1.0

# Of our own errors, and of what is broadcast.
UNSURE: Final = 1.4  # times the configured errors of our attitude and velocity: their sigmas are guesses, too
SMALLEST_SIGMA: Final = 1e-4  # rad; an axis of our attitude that is known better than this needs no state
PRESSURE_BIAS: Final = 30.0  # m: of a height by a pressure whose reference at sea level is not known
DELAY_TIME: Final = 600.0  # s: a link's delay lasts longer than an error of GNSS
DRIFT: Final = 0.5  # m/s: of the autopilot's position, beside its velocity
