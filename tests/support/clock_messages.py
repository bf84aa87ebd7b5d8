"""Messages with stamps of two clocks."""

from onboard.clocks import Clocks
from onboard.messages import Clock, Exposure, LocalPosition, TargetPoints, TimeSync
from onboard.messages.vehicle import TIMESYNC_TAG_NS

MS = 1_000_000
S = 1_000_000_000
EPOCH = 1_735_689_600 * S


def sample(t_ns: int, t_recv_ns: int) -> LocalPosition:
    return LocalPosition(t_ns=t_ns, t_recv_ns=t_recv_ns, r_OF_n=(0, 0, 0), v_F_n=(0, 0, 0))


def image(t_ns: int, t_recv_ns: int, clock: Clock = Clock.BOOT) -> Exposure:
    at = (0.0, 0.0)
    return Exposure.of(
        TargetPoints(t_ns=t_ns, t_recv_ns=t_recv_ns, clock=clock, camera="c", center=at, left=at, right=at)
    )


def run(clocks: Clocks, start_s: float, seconds: float, host_ns: int = EPOCH + 2 * MS, period_ms: int = 20) -> int:
    """Align samples every `period_ms`; how many were accepted."""
    accepted = 0
    for ms in range(round(start_s * 1000), round((start_s + seconds) * 1000), period_ms):
        accepted += clocks.align(sample(ms * MS, host_ns + ms * MS)).message is not None
    return accepted


def reply(
    boot_ns: int, out_ns: int, back_ns: int, *, host_ns: int = EPOCH, tag: int = TIMESYNC_TAG_NS
) -> TimeSync:
    """A reply made at boot time `boot_ns`, `out_ns` after its request was sent, received `back_ns` later."""
    ts1 = host_ns + boot_ns - out_ns
    ts1 += tag - ts1 % 1000
    recv = host_ns + boot_ns + back_ns
    return TimeSync(t_ns=recv, t_recv_ns=recv, clock=Clock.NONE, tc1_ns=boot_ns, ts1_ns=ts1)
