"""Where an image ends, of a camera whose principal point is not in the middle."""

import json

import pytest

from onboard.estimators.leader.image.prepare import in_view
from onboard.geometry.camera import make_camera
from onboard.wire.documents.document import BadDocumentError
from onboard.wire.documents.points import decode_points
from tests.unit.wire.test_points import document

CAMERA = make_camera(f_px=500.0, width_px=640.0, height_px=480.0)


def intrinsics(**changes: float) -> bytes:
    k = {"fx_px": 500.0, "fy_px": 400.0, "cx_px": 200.0, "cy_px": 240.0}
    return json.dumps(document(intrinsics=k | changes)).encode()


def test_with_the_size_of_the_image_each_edge_is_where_it_is() -> None:
    m = decode_points(intrinsics(width_px=640.0, height_px=480.0), 1).detections[0]
    assert m.view == pytest.approx((-0.4, -0.6, 0.88, 0.6))
    assert in_view([(0.87, 0.0)], CAMERA, m.view, 1.0)
    assert not in_view([(0.89, 0.0)], CAMERA, m.view, 1.0)
    assert in_view([(-0.39, 0.0)], CAMERA, m.view, 1.0)
    assert not in_view([(-0.41, 0.0)], CAMERA, m.view, 1.0)
    assert not in_view([(0.0, 0.61)], CAMERA, m.view, 1.0)


def test_without_it_the_principal_point_is_taken_as_the_middle() -> None:
    assert decode_points(intrinsics(), 1).detections[0].view == pytest.approx((-0.4, -0.6, 0.4, 0.6))
    assert decode_points(intrinsics(cx_px=0.0), 1).detections[0].view is None


def test_without_a_view_the_configured_camera_counts() -> None:
    assert in_view([(0.6, 0.4)], CAMERA, None, 1.0)
    assert not in_view([(0.65, 0.0)], CAMERA, None, 1.0)


@pytest.mark.parametrize("size", [{"width_px": 0.0, "height_px": 480.0}, {"width_px": 640.0, "height_px": -1.0}])
def test_an_image_without_a_size_is_refused(size: dict[str, float]) -> None:
    with pytest.raises(BadDocumentError, match="intrinsics"):
        decode_points(intrinsics(**size), 1)
