"""State of the view between records."""

from collections import defaultdict, deque
from dataclasses import dataclass, field

from onboard.messages import Estimate, MeasurementReport, NavState, OwnPose, Truth
from onboard.view.motion import LeaderArrays

EARLIEST_TIME_NS = -(10**18)
DRAW_RATE_HZ = 25.0  # of the scene, the image and the plots of our own state
STATUS_RATE_HZ = 5.0  # of texts


@dataclass(eq=False)
class Memory:
    """The latest record of each kind, and the times at which things were last drawn."""

    own: OwnPose | None = None
    truths: deque[Truth] = field(default_factory=lambda: deque(maxlen=100))
    waiting: defaultdict[str, deque[LeaderArrays]] = field(  # by estimator, until a truth of their time arrives
        default_factory=lambda: defaultdict(lambda: deque(maxlen=200))
    )
    own_states: deque[NavState] = field(default_factory=lambda: deque(maxlen=100))
    report: MeasurementReport | None = None
    t_image_ns: int = EARLIEST_TIME_NS
    drawn_ns: dict[str, int] = field(default_factory=dict)  # by name, when it was last drawn
    shown: dict[str, str] = field(default_factory=dict)  # by strip, the state it shows
    trail: dict[str, tuple[float, ...]] = field(default_factory=dict)  # by trail, where it ends
    rates: set[str] = field(default_factory=set)  # streams whose curve has its name
    traffic: dict[str, Estimate] = field(default_factory=dict)  # by target, the latest of each
    innovations: int = 0  # number of curves in the plot of innovations
    advice: str = ""  # of the newest health, as Markdown
    worst: str = ""  # the most severe advice, in a few words
    error: float | None = None  # distance of the last estimate from the truth, m

    def is_due(self, name: str, t_ns: int, hz: float) -> bool:
        """Whether to draw this at t_ns, with at most `hz`; if so, note it as drawn."""
        # a tenth of slack: jitter would otherwise drop every other record of a stream at exactly this rate
        if t_ns - self.drawn_ns.get(name, EARLIEST_TIME_NS) < 0.9e9 / hz:
            return False
        self.drawn_ns[name] = t_ns
        return True
