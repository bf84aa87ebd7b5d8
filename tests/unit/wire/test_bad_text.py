"""Bytes that are no UTF-8 in the JSON of a camera, a radar or a GNSS receiver cost that document, nothing else."""

from collections.abc import Callable

import pytest

from onboard.messages import Datagram, Encoding
from onboard.wire.datagrams import DatagramDecoder
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.points import decode_points
from onboard.wire.documents.pseudoranges import decode_ranges
from onboard.wire.documents.radar import decode_radar

LATIN_1 = "\u00fc".encode("latin-1")
PIXEL = b'{"u_px": 1.0, "v_px": 2.0}'
POINTS = (
    b'{"t_ns": 5, "clock": "boot", "camera": "%s", "intrinsics": {"fx_px": 5.0, "fy_px": 5.0, "cx_px": 1, '
    b'"cy_px": 1}, "center": ' + PIXEL + b', "left": ' + PIXEL + b', "right": ' + PIXEL + b"}"
)
SATELLITE = b'{"satellite": "%s", "r_e": [2e7, 0, 0], "v_e": [0, 3e3, 0], "pseudorange": 2e7, "rate": 1.0}'
DOCUMENTS = {
    Encoding.POINTS: POINTS,
    Encoding.RADAR: b'{"t_ns": 5, "clock": "boot", "radar": "%s"}',
    Encoding.RANGES: b'{"t_ns": 5, "clock": "boot", "peer": 2, "satellites": [' + SATELLITE + b"]}",
}
DECODE: dict[Encoding, Callable[[bytes, int], object]] = {
    Encoding.POINTS: decode_points,
    Encoding.RADAR: decode_radar,
    Encoding.RANGES: decode_ranges,
}


@pytest.mark.parametrize("encoding", DOCUMENTS, ids=str)
def test_a_latin_1_name_is_counted_and_the_next_document_is_read(encoding: Encoding) -> None:
    decoder = DatagramDecoder()

    def decode(name: bytes) -> int:
        data = DOCUMENTS[encoding] % name
        return len(decoder.decode(Datagram(channel="a", encoding=encoding, t_recv_ns=1, data=data)))

    assert [decode(LATIN_1), decode(b"front")] == [0, 1]
    assert decoder.rejected == {f"bad_{encoding}": 1}


@pytest.mark.parametrize("name", ["", "a b", "a\\nb", "x" * 65, "\u00fc", "a/b", "*", "../up"], ids=repr)
@pytest.mark.parametrize("encoding", [Encoding.POINTS, Encoding.RADAR], ids=str)
def test_a_camera_s_or_radar_s_name_that_could_be_no_key_is_refused(encoding: Encoding, name: str) -> None:
    with pytest.raises(BadDocumentError, match="name"):
        DECODE[encoding](DOCUMENTS[encoding] % name.encode(), 1)


@pytest.mark.parametrize("name", ["front", "nose-2", "cam_0.left", "x" * 64])
@pytest.mark.parametrize("encoding", [Encoding.POINTS, Encoding.RADAR], ids=str)
def test_a_plain_name_is_taken(encoding: Encoding, name: str) -> None:
    DECODE[encoding](DOCUMENTS[encoding] % name.encode(), 1)
