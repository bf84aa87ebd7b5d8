"""JSON -> WarmState of an earlier run, perhaps of another version or damaged."""

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from onboard.messages import WARM_VERSION, WarmState
from onboard.units import NS_PER_S
from onboard.wire.documents.document import BadDocumentError, load, parse

MAX_POSITION_M: Final = 1e5  # no leader and no position of ours is more distant
MAX_SPEED_M_S: Final = 1e3

_decoder = msgspec.json.Decoder(WarmState)


def decode_warm_state(data: bytes, t_recv_ns: int) -> WarmState:
    """Decode the state. Raises BadDocumentError, also for an implausible one."""
    tree = load(data, WarmState)
    version = tree.get("version") if isinstance(tree, dict) else None
    if version != WARM_VERSION:
        raise BadDocumentError(f"another version of onboard wrote it: {version!r}; expected {WARM_VERSION}")
    state = parse(_decoder, data)
    if reason := _find_error(state):
        raise BadDocumentError(reason)
    return replace(state, t_recv_ns=t_recv_ns, heartbeat=replace(state.heartbeat, t_recv_ns=t_recv_ns))


def _find_error(state: WarmState) -> str:
    """Describe the first implausible value of a state and its place; "" without one."""
    mean, P, n = state.estimate.mean, state.estimate.covariance, len(state.estimate.components)
    if not state.estimate.valid or mean is None or P is None:
        return "expected a valid estimate - at `$.estimate`"
    if n < 6 or len(mean) != n or len(P) != n or any(len(row) != n for row in P):
        return f"expected {max(n, 6)} components - at `$.estimate`"
    if math.hypot(*mean[:3]) > MAX_POSITION_M or math.hypot(*mean[3:6]) > MAX_SPEED_M_S:
        return "expected a leader within 100 km, slower than 1000 m/s - at `$.estimate.mean`"
    symmetric = all(math.isclose(P[i][j], P[j][i], rel_tol=1e-6, abs_tol=1e-9) for i in range(n) for j in range(i))
    if not symmetric or any(not P[i][i] > 0.0 for i in range(6)):
        return "expected a symmetric matrix with positive variances - at `$.estimate.covariance`"
    own = state.own
    if any(x is None or abs(x) > MAX_POSITION_M for x in own.r_OF_n) or math.hypot(*own.v_F_n) > MAX_SPEED_M_S:
        return "expected a known position within 100 km - at `$.own`"
    if abs(state.own.t_ns - state.t_ns) > NS_PER_S or state.estimate.t_ns != state.t_ns:
        return "expected one time - at `$.t_ns`"
    return ""
