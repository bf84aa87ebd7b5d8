"""State of the view between records: the latest of each kind, and data that later records need."""

from collections import defaultdict, deque
from dataclasses import dataclass, field

from onboard.messages import Estimate, MeasurementReport, NavState, OwnPose, Truth
from onboard.view.motion import LeaderArrays

NEVER = -(10**18)


@dataclass(eq=False)
class Memory:
    """The latest of everything; `drawn_ns`: when each thing was last drawn, by name."""

    own: OwnPose | None = None
    truths: deque[Truth] = field(default_factory=lambda: deque(maxlen=100))
    waiting: defaultdict[str, deque[LeaderArrays]] = field(  # by estimator, for a truth of their time
        default_factory=lambda: defaultdict(lambda: deque(maxlen=200))
    )
    own_states: deque[NavState] = field(default_factory=lambda: deque(maxlen=100))
    report: MeasurementReport | None = None
    t_image_ns: int = NEVER
    drawn_ns: dict[str, int] = field(default_factory=dict)
    shown: dict[str, str] = field(default_factory=dict)  # by strip, the state it shows
    trail: dict[str, tuple[float, ...]] = field(default_factory=dict)  # by trail, where it ends
    rates: set[str] = field(default_factory=set)  # streams whose curve has its name
    traffic: dict[str, Estimate] = field(default_factory=dict)  # by target, the latest of each
    innovations: int = 0  # how many curves the plot of innovations has
    advice: str = ""  # of the newest health, Markdown
    worst: str = ""  # of it, in a few words
    error: float | None = None  # distance of the last estimate from the truth, m

    def due(self, name: str, t_ns: int, hz: float) -> bool:
        """Whether to draw this at t_ns, at no more than `hz`; if so, remembers it as drawn."""
        # a tenth of slack, or a stream at just this rate would lose every other record to its jitter
        if t_ns - self.drawn_ns.get(name, NEVER) < 0.9e9 / hz:
            return False
        self.drawn_ns[name] = t_ns
        return True
