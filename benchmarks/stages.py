"""The cost of a message at each stage, and the speed of a replay.

The flight is 35 s of a MAVLink stream of an ArduPilot: 500 messages a second, with 25 images among them.
"""

import gzip
import time
from pathlib import Path
from typing import Final

import msgspec

from benchmarks import floor
from onboard.config import Config, load_config
from onboard.messages import Datagram
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog

LOG: Final = Path(__file__).parents[1] / "tests" / "replay" / "data" / "copter.tlog.gz"
SETTINGS: Final = ("camera.mount_rpy_deg=[0,15,0]", "estimator.leader.size_prior_m=2.0")


def measure() -> dict[str, float]:
    """Measure microseconds for each message at each stage, and the speed of replays.

    The speed is the flight's seconds over those of its replay, also for `floor`.
    """
    log = gzip.decompress(LOG.read_bytes())
    config, bare = load_config(None, SETTINGS), load_config(None, ("estimator={}",))
    began = time.process_time()
    datagrams = [datagram for datagram, _ in read_tlog(log) if datagram is not None]
    reading = time.process_time() - began
    _feed(config, datagrams[:5000])  # loaded, and warm
    decoding, bare_s, _ = _feed(bare, datagrams)
    _, whole_s, encoding = _feed(config, datagrams)
    flight_s = (datagrams[-1].t_recv_ns - datagrams[0].t_recv_ns) * 1e-9
    us, floor_s = 1e6 / len(datagrams), floor.replay_s(datagrams)
    return {
        "read_us": reading * us,
        "decode_us": decoding * us,
        "align_us": bare_s * us,
        "estimate_us": (whole_s - bare_s) * us,
        "encode_us": encoding * us,
        "replay_times": flight_s / (reading + decoding + whole_s),
        "floor_replay_times": flight_s / (reading + floor_s),
        "messages_per_s": len(datagrams) / flight_s,
    }


def _feed(config: Config, datagrams: list[Datagram]) -> tuple[float, float, float]:
    """Return the seconds of decoding, of everything after it, and of encoding the outputs."""
    pipeline, encoder = Pipeline(config), msgspec.json.Encoder()
    began = time.process_time()
    decoded = [pipeline.decode(datagram) for datagram in datagrams]
    advanced = time.process_time()
    outputs = [output for messages in decoded for output in pipeline.advance(messages)]
    ended = time.process_time()
    for output in outputs:
        encoder.encode(output)
    return advanced - began, ended - advanced, time.process_time() - ended
