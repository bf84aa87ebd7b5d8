"""The numbers that the leader's filter believes, and why.

How a leader flies (`LeaderModel`), and below that how aircraft look, how detectors and our own state err, and the
limits of computation.

Plain numbers: reading a configuration imports neither NumPy nor Numba. Compiled arithmetic contains them: whoever
changes one compiles anew."""

import math
from typing import Final, NamedTuple

from onboard.units import NS_PER_S

PARTICLES: Final = 900  # hypotheses at most


class Size(NamedTuple):
    """The wingspan and its standard deviation, m."""

    value: float
    sigma: float


class LeaderModel(NamedTuple):
    """Assumptions about how a leader of unknown heading flies, and about our own errors.

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
    heading: float = math.radians(5.0)  # rad, of the heading about our own course, of one that flies along with us
    on_course: float = 0.3  # the prior probability that it does, if we fly
    nose_about_course: float = math.radians(5.0)  # rad, of a heading that is locked to its course
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
# Radius of a rotor, of half the distance to its neighbour: 0.7 to 1 by data sheets
ROTOR_RADIUS_RATIO: Final = 0.8
ROTOR_PLANE_HEIGHT: Final = -0.04  # how high they are
CANOPY_AND_FEET: Final = ((0.0, 0.0, -0.09), (0.0, 0.0, 0.19))  # canopy and feet ...
# ... which differ by data sheet: one standard deviation of top and bottom
CANOPY_AND_FEET_SIGMA: Final = 0.08
PITCH: Final = math.radians(7.0)  # rad, of the fuselage about the pitch that thrust implies

# Of detectors: points, boxes, and poses.
KEYPOINT_SIGMA_RATIO: Final = 0.03  # of the wingspan: how far a detector misplaces a point of an aircraft
MIN_BOX_SIGMA_RATIO: Final = 0.05  # of the box's larger side: what a detector says of each side is no less
BOX_BIAS: Final = 0.08  # of its size: a detector's boxes are all too wide, or all too narrow ...
GENERIC_BOX_BIAS: Final = 0.15  # ... and of a wing in usual proportions, so is what they bound
CENTER_OFFSET_RATIO: Final = 0.1  # of the wing: the center from the wing's middle, where nothing is known of it
# The same with `center_on_wing`, which allows 1 %; the nearer half of a wing looks longer
CENTER_ON_WING_OFFSET_RATIO: Final = 0.02
BOX_CENTER_OFFSET_RATIO: Final = 0.1  # of the box's side: the center from the box's middle
OFFSET_BIAS_FACTOR: Final = 4.0  # times: a filter averages some sixteen images
MARKER_HEADING_BIAS: Final = math.radians(2.0)  # rad, of a marker that is mounted askew, or a model that is
MIN_RANGE_SIGMA_RATIO: Final = 0.002  # of the range: no detector is more exact
MIRRORED_POSE_PROBABILITY: Final = 0.2  # the probability that a rotation is the mirror image ...
STRAY_POSE_PROBABILITY: Final = 0.02  # ... and that it says nothing

# Of our own errors, and of what is broadcast.
# Times the configured errors of our attitude and velocity: their sigmas are guesses, too
OWN_SIGMA_FACTOR: Final = 1.4
MIN_OWN_SIGMA: Final = 1e-4  # rad; an axis of our attitude that is known better than this needs no state
PRESSURE_BIAS_M: Final = 30.0  # m: of a height by a pressure whose reference at sea level is not known
DELAY_TIME_S: Final = 600.0  # s: a link's delay lasts longer than an error of GNSS
OWN_DRIFT_M_S: Final = 0.5  # m/s: of the autopilot's position, beside its velocity

# Of images that leap, and of classes that come by turns.
MAX_IMAGE_INTERVAL_S: Final = 0.3  # Over longer gaps an aircraft may have moved anywhere.
MIN_BEARING_STEP: Final = math.radians(2.0)  # A few pixels: less is noise.
MAX_BEARING_RATE: Final = math.radians(60.0)  # 1/s; 10 m/s across the line of sight at 10 m.
SIZE_JUMP_SIGMAS: Final = 4.0  # of both sizes' noise
CLASS_AMBIGUITY_RATIO: Final = 0.75  # Another class as frequent as this leaves open which one is right.
MAX_SIGHT_ANGLE: Final = math.radians(30.0)  # from the last sight: a place farther off is mirrored through us.

# Of a track's life.
REACQUISITION_INTERVAL_NS: Final = NS_PER_S  # After so long without images: is the leader where it was believed?
BROADCAST_DISTRUST_TIME_NS: Final = 10 * NS_PER_S  # after a broadcast that was wrong
CONTRADICTING_REPORT_LIMIT: Final = 4  # in a row: then what they have carried is not believed.
REPORTED_TRACK_TIMEOUT_NS: Final = 30 * NS_PER_S  # Without a report, nothing that was known is of use then.
MAX_RANGED_SIGMA: Final = 0.1  # rad, of a direction: known less well, a range says nothing of the leader.
REPORT_DELAY_MARGIN_S: Final = 0.5  # beyond the configured latency
MEAN_NIS_AFTER_LOSS: Final = 2.0  # of a track that begins after another one, which no image fitted
MAX_CORRECTED_DIRECTION_SIGMA: Final = 0.2  # rad: beyond it no tangent holds, and the track starts anew.

# Of reports.
MAX_REPORT_AGE_NS: Final = 1_500_000_000  # What we and the camera did before is forgotten.
UNKNOWN_VELOCITY_SIGMA: Final = 300.0  # m/s, of a velocity that is not reported

# Of an earlier run.
MAX_PRIOR_AGE_S: Final = 10.0  # Later, the leader may be anywhere.
UNSEEN_ACCELERATION_TIME_S: Final = 3.0  # correlation time of the acceleration that nobody saw
FLIGHT_SPEED_SIGMAS: Final = 2.0  # above 0: it did not hover.
MAX_HOVER_SPEED: Final = 1.0  # m/s: a slower leader has no course to turn from.

# Of a detector's noise, and of a camera that hangs.
NOISE_WINDOW: Final = 60  # images, two seconds
NOISE_RATIO_LIMIT: Final = 2.0  # of the median of chi-square: no chance with so many images
OUTLIER_NIS: Final = 13.8  # Chi-square with two degrees of freedom exceeds it once in a thousand.
MAX_NOISE_SCALE: Final = 6.0  # of the configured noise: images that fit worse come of something else.
REPORTED_NOISE_SCALE: Final = 1.3
MAX_SUCCESSIVE_INTERVAL_NS: Final = NS_PER_S // 4  # to the next image of the same camera
UNCHANGED_POINT_SIGMAS: Final = 0.35  # No detector is so quiet.
ROTATION_SIGMAS: Final = 3.0  # A point that our rotation would have moved by more must have moved.
MIN_UNCHANGED_IMAGES: Final = 3  # Two may be alike by chance.
MIN_LEVEL_HEADING: Final = 0.2  # One that points up or down more steeply has no heading.

# Of one image.
WINGTIP_NAME_NOISE: Final = 0.3  # of the wing: tips that are to say only which one is left
WINGTIP_NAME_SIGMAS: Final = 3.0  # of their own, at least
MAX_SPAN_RATIO: Final = 1.3  # between images of one aircraft a moment apart
MIN_SPAN_SIGMAS: Final = 2.0  # A smaller span says nothing of the range by itself.
MIN_NOSE_LENGTH: Final = 0.1  # of the wingspan: closer points show no nose.
POINT_SIGMA_LIMITS: Final = (1e-7, 10.0)  # focal lengths: no detector is more exact or less.

# Of the gates, the evidence and the mean NIS per component.
MAX_SIZE_SIGMAS: Final = 3.0  # of the configured size: what may be false leads it no farther.
MAX_PREDICTION_STEP_S: Final = 0.25  # of the hypotheses, in one step
MEAN_NIS_LIMIT: Final = 1.4  # Chosen on encounters, between availability and error.
MIN_WEIGHT_IN_GATE: Final = 0.3  # Particles of so much weight must have expected an image.
REPORT_GATE_PROBABILITY: Final = 0.9999  # that a report or a range passes that is true
REPORT_EVIDENCE_TIME_S: Final = 0.2  # Each counts as if the next one came so soon.
STARTUP_TIME_S: Final = 8.0  # over which the evidence of a new track is used
MIN_EVIDENCE_INTERVAL_S: Final = 0.05  # What is measured at one time counts as if it came so soon after.
MEAN_NIS_TIME_S: Final = 3.0  # over which it is averaged
MAX_IMAGE_NIS: Final = 3.0  # per component: a stray image counts no more.
MIN_SHAPE_WEIGHT: Final = 0.02  # Only the right headings expect a shape.
SHAPE_GATE_NIS_PER_ROW: Final = 2.1  # more of the gate, for each row of a shape

# Of a first image.
MIN_FIRST_RANGE_RATIO: Final = 0.05  # of the largest possible range: points in a row may hide each other.
MAX_GAUSSIAN_SIZE_SIGMA: Final = 0.05  # A size known less well is sampled: a Gaussian's curvature would mislead.
RESTART_HEADING_INTERVAL: Final = 5  # One particle of so many has a new heading when a track starts again.
MAX_FIRST_BANK: Final = math.radians(35.0)  # rad, of headings that are looked at closely
MIN_FORMATION_SPEED: Final = 3.0  # m/s: if we fly faster, a leader that flies along with us is likely.

# Of targets and their ids.
AMBIGUOUS_COST: Final = 2.0 * math.log(10.0)  # An assignment that is ten times as likely is decided.
MAX_COMPARISON_COUNT: Final = 8  # of a track with the images nearest to it
MAX_TARGET_OFFSET: Final = 0.2  # rad: an image farther from every track is of another aircraft.
TRACK_START_PERIOD_NS: Final = 50_000_000  # between tracks that begin beside a leader's: each takes 10 ms.
REFUSAL_PERIOD_NS: Final = 100_000_000  # between reports of images that are one target too many
SERVED_TIME_NS: Final = NS_PER_S  # A camera shows the leader for so long after an image of its was fused.

# Of motion, compiled. A power of a speed stands for the speed, as no root is taken.
MIN_VISIBLE_FRACTION: Final = 0.05  # of the wing: seen exactly along itself, it still shows a tip.
MIN_SPEED_SQUARED: Final = 1.0  # (m/s)^2, in place of 0/0 where a course would be divided by.
TURN_SPEED_SQUARED: Final = 4.0  # (m/s)^2: a slower leader does not turn its velocity.
COURSE_LEAD_TIME_S: Final = 0.5  # A heading locked to its course points where the course leads so much later.
FOLLOWING_SPEED_POWER4: Final = 81.0  # (m/s)^4: a faster leader turns its heading with its course.
COURSE_UNLOCK_SPEED_SQUARED: Final = 9.0  # (m/s)^2: a slower leader's heading is not locked to its course.
MAX_HOVER_SPEED_SQUARED: Final = 0.16  # (m/s)^2: a faster leader does not hover.
HOVER_HEIGHT_VARIANCE_RATIO: Final = 0.3  # A hovering leader holds its height better than its place.
COURSE_ITERATIONS: Final = 5  # of heading, the range that it implies, and the course at that range
OBSERVED_HEADING_TIME_FACTOR: Final = 10.0  # A particle keeps its heading so much longer where points show it.

# Of the tilt of a multirotor, compiled.
TILT_VARIANCE: Final = 0.01  # (m/s^2)^2, of the tilt of one that has no drag
STEADY_TILT_VARIANCE: Final = 12.0  # (m/s^2)^2, of any multirotor, on each axis; 20 degrees are one sigma.
MAX_PRIOR_COST: Final = 20.0  # log-likelihood: what a hypothesis supposes is improbable enough then.
MIN_VIEW_LENGTH: Final = 1e-9  # in place of 0/0: of the distance straight above us, m, and of a wing seen edge-on

# Of rows, compiled.
STUDENT_T_DOF: Final = 4.0  # What a leader does is no Gaussian.
MIN_WING_SIGMAS_SQUARED: Final = 9.0  # A wing shorter than three standard deviations has no logarithm.
MIN_DEVIATION: Final = 1e-12  # of a covariance that has lost its rank

# Of the number of particles (Fox, 2003), their weights, and the places where a leader may be.
HEADING_BIN: Final = math.radians(6.0)
RANGE_BIN: Final = 0.05  # of the range's logarithm
MIN_BIN_WEIGHT: Final = 0.002  # of a bin that counts
PARTICLES_PER_BIN: Final = 6
COUNT_CHANGE_FACTOR: Final = 1.5  # The number of particles changes by this factor at least.
MAX_LOG_LIKELIHOOD_RATIO: Final = 40.0  # by one measurement
MAX_RESOLVED_RANGE_SIGMA: Final = 0.15  # of the range: particles that are less certain leave it open.
LOG_RANGE_BIN_WIDTH: Final = 0.04  # of the density whose modes are places
DENSITY_SMOOTHING_WIDTH: Final = 2.5  # bins, one standard deviation
MAX_VALLEY_RATIO: Final = 0.6  # to the lower of two peaks: with less density between them they are apart.
MIN_PLACE_WEIGHT: Final = 0.05  # Less is no place of its own.

# Of images that are kept, and of what is computed of them.
RATE_INTERVAL_NS: Final = 40_000_000  # over which the rates of a camera are computed
MAX_POSE_COUNT: Final = 64  # kept while images come but no own motion
STAMP_COUNT: Final = 64  # remembered
MEDIAN_NIS: Final = 2.0 * math.log(2.0)  # of chi-square with two degrees of freedom
MAX_AGREEING_ANGLE: Final = math.radians(5.0)  # between images of one aircraft that start a track
RIM_POINT_COUNT: Final = 12  # of all rotors' rims, beside the ends of each
