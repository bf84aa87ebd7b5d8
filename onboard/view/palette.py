"""Colours, each with one meaning in every panel, as RGB, or RGBA where translucent."""

from onboard.messages import FaultKind, Lifecycle, Verdict

Colour = tuple[int, int, int] | tuple[int, int, int, int]

ESTIMATE: Colour = (64, 190, 255)
UNCERTAIN: Colour = (255, 105, 190)
BAND_COLOUR: Colour = (38, 104, 140)
TRUTH: Colour = (240, 240, 240)
OWN_COLOUR: Colour = (255, 184, 77)
GATE_COLOUR: Colour = (190, 70, 70)
GRID_COLOUR: Colour = (60, 66, 72)
FAINT: Colour = (110, 118, 126)
AXIS_RGB: tuple[Colour, Colour, Colour] = ((255, 120, 110), (120, 220, 120), (130, 160, 255))

GREEN: Colour = (70, 190, 105)
AMBER: Colour = (245, 170, 50)
RED: Colour = (235, 75, 75)
VIOLET: Colour = (160, 130, 255)
GREY: Colour = (105, 110, 115)
DARK: Colour = (60, 63, 66)

BESIDE_COLOURS: dict[str, Colour] = {  # other estimators of the leader, by the colour's name
    "lime": (170, 235, 80),
    "copper": (215, 130, 85),
    "turquoise": (80, 220, 205),
}

STATES: dict[str, Colour] = {
    Lifecycle.SEARCHING: GREY,
    Lifecycle.INITIALISING: VIOLET,
    Lifecycle.TRACKING: GREEN,
    Lifecycle.COASTING: AMBER,
    Lifecycle.LOST: RED,
}

NO_IMAGE_VERDICT = "no image"

VERDICTS: dict[str, Colour] = {
    Verdict.FUSED: GREEN,
    Verdict.FUSED_LATE: (60, 170, 160),
    Verdict.INITIALISING: VIOLET,
    Verdict.GATED: RED,
    Verdict.DUPLICATE: GREY,
    Verdict.TOO_OLD: AMBER,
    Verdict.TOO_NEW: AMBER,
    Verdict.NOT_FINITE: (220, 90, 180),
    Verdict.DEGENERATE: (220, 90, 180),
    Verdict.NO_POSE: AMBER,
    Verdict.NUMERICAL: (220, 90, 180),
    Verdict.OUT_OF_VIEW: AMBER,
    Verdict.STALE: AMBER,
    Verdict.NO_POSITION: AMBER,
    Verdict.IMPLAUSIBLE: RED,
    Verdict.UNASSOCIATED: GREY,
    Verdict.OURSELVES: GREY,
    Verdict.DIRECTION_ONLY: AMBER,
    Verdict.FULL: AMBER,
    NO_IMAGE_VERDICT: DARK,
}

NO_FAULT = "no fault"
MAX_MOTOR_NUMBER = 12

FAULTS: dict[str, Colour] = {  # by the part where there is one, else by the kind
    NO_FAULT: DARK,
    **{f"motor {k}": RED for k in range(1, MAX_MOTOR_NUMBER + 1)},
    FaultKind.MASS: RED,
    FaultKind.GUST: VIOLET,
    FaultKind.OUTLIERS: AMBER,
}


def shade(colour: Colour, brightness: float) -> Colour:
    """Return the same hue, darker."""
    red, green, blue = (round(brightness * c) for c in colour[:3])
    return red, green, blue
