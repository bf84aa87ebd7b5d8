"""JSON -> WarmState. What is read was written by another run, perhaps of another version, and may be damaged."""

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from onboard.messages import WARM_VERSION, WarmState
from onboard.units import NS_PER_S
from onboard.wire.documents.document import BadDocumentError, load, parse

LONGEST_RANGE: Final = 1e5  # m: what is farther away is no leader, or no position of ours
FASTEST_KEPT: Final = 1e3  # m/s

_decoder = msgspec.json.Decoder(WarmState)


def decode_warm_state(data: bytes, t_recv_ns: int) -> WarmState:
    """The state of one JSON document. Raises BadDocumentError, also for one that no run can have left."""
    tree = load(data, WarmState)
    version = tree.get("version") if isinstance(tree, dict) else None
    if version != WARM_VERSION:
        raise BadDocumentError(f"another version of onboard wrote it: {version!r}; expected {WARM_VERSION}")
    state = parse(_decoder, data)
    if reason := _impossible(state):
        raise BadDocumentError(reason)
    return replace(state, t_recv_ns=t_recv_ns, heartbeat=replace(state.heartbeat, t_recv_ns=t_recv_ns))


def _impossible(state: WarmState) -> str:
    """What is wrong with a state, with its place; "" if nothing is."""
    mean, P, n = state.estimate.mean, state.estimate.covariance, len(state.estimate.components)
    if not state.estimate.valid or mean is None or P is None:
        return "expected a valid estimate - at `$.estimate`"
    if n < 6 or len(mean) != n or len(P) != n or any(len(row) != n for row in P):
        return f"expected {max(n, 6)} components - at `$.estimate`"
    if math.hypot(*mean[:3]) > LONGEST_RANGE or math.hypot(*mean[3:6]) > FASTEST_KEPT:
        return "expected a leader within 100 km, slower than 1000 m/s - at `$.estimate.mean`"
    symmetric = all(math.isclose(P[i][j], P[j][i], rel_tol=1e-6, abs_tol=1e-9) for i in range(n) for j in range(i))
    if not symmetric or any(not P[i][i] > 0.0 for i in range(6)):
        return "expected a symmetric matrix with positive variances - at `$.estimate.covariance`"
    own = state.own
    if any(x is None or abs(x) > LONGEST_RANGE for x in own.r_OF_n) or math.hypot(*own.v_F_n) > FASTEST_KEPT:
        return "expected a known position within 100 km - at `$.own`"
    if abs(state.own.t_ns - state.t_ns) > NS_PER_S or state.estimate.t_ns != state.t_ns:
        return "expected one time - at `$.t_ns`"
    return ""
