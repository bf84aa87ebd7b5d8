"""The static parts of the view: shapes, colours, names of curves; logged once, without a time.

The scene's origin is the follower F, its axes are NED, so that both aircraft stay in front of the eye while they
cross the country. Below it, `scene/ground` is at the EKF origin O and carries the trails.
"""

from collections.abc import Sequence

import numpy as np

from onboard.geometry.camera import Camera
from onboard.geometry.rotations import quaternion_from_matrix
from onboard.view import palette, shapes
from onboard.view.sdk import rr

SCENE = "scene"
HEADING = f"{SCENE}/heading"  # level, turns with our nose: the chase view's frame
FOLLOWER = f"{SCENE}/follower"
CAMERA = f"{FOLLOWER}/camera"
MAGNIFIER = f"{CAMERA}/magnifier"  # below the image: the surroundings of the prediction, enlarged
LEADER_PATH = f"{SCENE}/leader"
TRUE_SIZE = f"{LEADER_PATH}/true_size"  # in the close view
ENLARGED = f"{LEADER_PATH}/enlarged"  # in the chase view
LEADER_TRUTH = f"{SCENE}/leader_truth"
UNCERTAINTY = f"{SCENE}/uncertainty"
AROUND_LEADER = f"{SCENE}/around_leader"  # level, at the leader, turns with our nose: the close-up's frame
LEADER_VELOCITY = f"{SCENE}/leader_velocity"
OWN_VELOCITY_PATH = f"{SCENE}/own_velocity"
SIGHT_LINE = f"{SCENE}/sight_line"
OPEN_RANGE = f"{SCENE}/open_range"  # where the range is open: from the nearest to the farthest place
OPEN_ENDS = (f"{SCENE}/open_near", f"{SCENE}/open_far")
DROP_LINE = f"{SCENE}/drop_line"
TAG = f"{SCENE}/tag"
BESIDE_PATH = f"{SCENE}/beside"  # below it, the leader as each other estimator places it
BESIDE_TAG = f"{SCENE}/beside_tag"
WEAK = f"{FOLLOWER}/shape/weak"  # below it, a red disc for each rotor
OWN_TAG = f"{SCENE}/own_tag"
BANNER = "banner"
OWN_BANNER = "own_banner"
ROTORS_PATH = "rotors"  # our vehicle from above
GRID_PATH = f"{SCENE}/grid"
GROUND = f"{SCENE}/ground"
TRAILS = {name: f"{GROUND}/trail_{name}" for name in ("own", "estimate", "truth")}

# entities whose position comes with records: hidden before the first
MOVING = (
    *(FOLLOWER, OWN_VELOCITY_PATH, GRID_PATH, GROUND),
    *(LEADER_PATH, LEADER_TRUTH, LEADER_VELOCITY, UNCERTAINTY, *OPEN_ENDS),
)

DRAWN_SIGMAS = 3.0
GRID_SPACING = 10.0  # m
LEADER_SCALE = 2.0  # in the chase view, where the leader is far from the eye
FOLLOWER_SPAN = 2.0  # m, of the glyph: the real one is unknown
VELOCITY_SCALE = 0.3  # s: a velocity arrow is as long as the way flown in this time

Rotors = Sequence[Sequence[float]]  # forward and right of the centre, m, and what else is known of each

# curves of each plot entity: (name, colour, width)
Curve = tuple[str, palette.Colour, float]
BAND_CURVES: list[Curve] = [("+3σ", palette.BAND_COLOUR, 1.0), ("-3σ", palette.BAND_COLOUR, 1.0)]


def with_band(name: str = "estimate", colour: palette.Colour = palette.ESTIMATE) -> list[Curve]:
    """Return the curves of a quantity and its band."""
    return [(name, colour, 2.0), *BAND_CURVES]


AXIS_NAMES = ("north", "east", "down")
OWN_NAMES = (*AXIS_NAMES, "roll", "pitch", "yaw", "height")
TRUTH_CURVE: list[Curve] = [("truth", palette.TRUTH, 1.2)]

PLOTS: dict[str, list[Curve]] = {
    "plots/range/estimate": with_band(),
    "plots/range/truth": TRUTH_CURVE,
    "plots/range_error": with_band("error"),
    "plots/size/estimate": with_band(),
    "plots/size/truth": TRUTH_CURVE,
    **{f"plots/error/{axis}": with_band("error") for axis in AXIS_NAMES},
    **{f"plots/velocity/{axis}/estimate": with_band() for axis in AXIS_NAMES},
    **{f"plots/velocity/{axis}/truth": TRUTH_CURVE for axis in AXIS_NAMES},
    **{f"plots/acceleration/{axis}/estimate": with_band() for axis in ("lateral", "longitudinal")},
    **{f"plots/acceleration/{axis}/truth": TRUTH_CURVE for axis in ("lateral", "longitudinal")},
    "plots/innovation/gate": [("+3σ", palette.GATE_COLOUR, 1.0), ("-3σ", palette.GATE_COLOUR, 1.0)],
    "plots/nis/gate": [("gate", palette.GATE_COLOUR, 1.5)],
    "plots/consistency/bounds": [("bounds", palette.GATE_COLOUR, 1.0), ("bounds", palette.GATE_COLOUR, 1.0)],
    "plots/age": [("age of last image fused", palette.AMBER, 1.5)],
    **{f"plots/own/{name}/estimate": with_band() for name in OWN_NAMES},
    **{f"plots/own/{name}/autopilot": [("autopilot", palette.OWN_COLOUR, 1.2)] for name in OWN_NAMES},
    **{f"plots/own/{name}/truth": TRUTH_CURVE for name in OWN_NAMES},
    "plots/own/velocity_error/band": BAND_CURVES,
    "plots/own/velocity_error/error": [(n, c, 1.3) for n, c in zip(AXIS_NAMES, palette.AXIS_RGB, strict=True)],
    "plots/own/attitude_error/band": BAND_CURVES,
    "plots/own/attitude_error/error": [(n, c, 1.3) for n, c in zip(OWN_NAMES[3:6], palette.AXIS_RGB, strict=True)],
    "plots/own/trust": [("outside the layer %", palette.RED, 1.5), ("quality %", palette.GREEN, 1.5)],
}


def log_curves(stream: "rr.RecordingStream", entity: str, curves: list[Curve]) -> None:
    """Log names, colours and widths of the curves of one plot entity."""
    style = rr.SeriesLines(
        names=[name for name, _, _ in curves],
        colors=[colour for _, colour, _ in curves],
        widths=[width for _, _, width in curves],
    )
    stream.log(entity, style, static=True)


def log_plots(stream: "rr.RecordingStream") -> None:
    """Log the style of every plot and of the strips of states."""
    for entity, curves in PLOTS.items():
        log_curves(stream, entity, curves)
    points = rr.SeriesPoints(names="NIS", colors=palette.ESTIMATE, marker_sizes=2.5)
    stream.log("plots/nis/value", points, static=True)
    for entity, colours in (
        ("track", palette.STATES),
        ("images", palette.VERDICTS),
        ("own_state", palette.STATES),
        ("faults", palette.FAULTS),
    ):
        names = [str(name) for name in colours]
        style = rr.StateConfiguration(
            values=names, labels=[n.replace("_", " ").upper() for n in names], colors=list(colours.values())
        )
        stream.log(entity, style, static=True)


def log_mesh(stream: "rr.RecordingStream", entity: str, mesh: shapes.Mesh, colour: palette.Colour) -> None:
    """Log a shape in one colour."""
    body = rr.Mesh3D(vertex_positions=mesh.vertices, vertex_normals=mesh.normals, albedo_factor=colour)
    stream.log(entity, body, static=True)


def log_lines(
    stream: "rr.RecordingStream", entity: str, strips: list[np.ndarray], colour: palette.Colour, width: float
) -> None:
    """Log lines with a width in screen points, independent of their scale."""
    lines = rr.LineStrips3D(strips, colors=colour, radii=rr.Radius.ui_points(width))
    stream.log(entity, lines, static=True)


def image_size(camera: Camera) -> tuple[float, float]:
    """Return width and height of the image, px."""
    return float(camera.width_px), float(camera.height_px)


def magnifier(camera: Camera) -> tuple[float, float, float, float]:
    """Return left, top, width and height, px, of the magnifier below the image."""
    w, h = image_size(camera)
    return 0.0, 1.04 * h, w, 0.5 * h


def log_camera(stream: "rr.RecordingStream", camera: Camera) -> None:
    """Log the camera's mount and field of view, and the frame of its image."""
    q = quaternion_from_matrix(camera.R_bc)
    mount = rr.Transform3D(translation=camera.r_FC_b, quaternion=rr.Quaternion(xyzw=q[[1, 2, 3, 0]]))
    lens = rr.Pinhole(
        focal_length=camera.f_px,
        width=camera.width_px,
        height=camera.height_px,
        principal_point=(camera.width_px / 2, camera.height_px / 2),
        camera_xyz=rr.ViewCoordinates.FRD,
        image_plane_distance=4.0,
        color=palette.FAINT,
        line_width=-0.8,  # negative: a width in points of the screen
    )
    stream.log(CAMERA, mount, lens, static=True)
    w, h = image_size(camera)
    cross = [[(w / 2 - 8, h / 2), (w / 2 + 8, h / 2)], [(w / 2, h / 2 - 8), (w / 2, h / 2 + 8)]]
    log_frame(stream, f"{CAMERA}/frame", [rectangle(0.0, 0.0, w, h), *cross])
    log_frame(stream, f"{MAGNIFIER}/frame", [rectangle(*magnifier(camera))])


def rectangle(x: float, y: float, w: float, h: float) -> list[tuple[float, float]]:
    """Return the closed outline of a rectangle from its upper left corner."""
    return [(x, y), (x + w, y), (x + w, y + h), (x, y + h), (x, y)]


def log_frame(
    stream: "rr.RecordingStream", entity: str, strips: list[list[tuple[float, float]]], width: float = 0.7
) -> None:
    """Log thin lines that frame an image."""
    lines = rr.LineStrips2D(strips, colors=palette.FAINT, radii=rr.Radius.ui_points(width))
    stream.log(entity, lines, static=True)


def log_image_styles(stream: "rr.RecordingStream") -> None:
    """Log sizes of marks in image and magnifier; records bring positions and colours."""
    hair = rr.Radius.ui_points(0.8)
    for place, size in ((CAMERA, 2.2), (MAGNIFIER, 3.5)):
        dots = rr.Points2D.from_fields(radii=rr.Radius.ui_points(size), draw_order=30.0)
        stream.log(f"{place}/measured", dots, static=True)
        predicted = rr.Ellipses2D.from_fields(colors=palette.ESTIMATE, line_radii=hair, draw_order=20.0)
        stream.log(f"{place}/predicted", predicted, static=True)
        for name, colour in (("measured_wing", palette.FAINT), ("predicted_wing", palette.ESTIMATE)):
            lines = rr.LineStrips2D.from_fields(colors=colour, radii=hair, draw_order=10.0)
            stream.log(f"{place}/{name}", lines, static=True)
    stream.log(f"{CAMERA}/verdict", rr.Points2D.from_fields(radii=0.0, show_labels=True), static=True)


def log_aircraft(stream: "rr.RecordingStream", rotors: Rotors) -> None:
    """Log both aircraft, arrows, uncertainty, the grid and the style of the trails."""
    glass = (*palette.ESTIMATE[:3], 150)  # along the line of sight the ellipsoid lies inside the fuselage
    for entity in (TRUE_SIZE, ENLARGED):
        log_mesh(stream, f"{entity}/body", shapes.aeroplane(), glass)
        log_lines(stream, f"{entity}/outline", shapes.aeroplane_outline(), palette.ESTIMATE, 0.8)
    stream.log(ENLARGED, rr.Transform3D(scale=LEADER_SCALE), static=True)
    log_lines(stream, f"{LEADER_TRUTH}/shape", shapes.aeroplane_outline(), palette.TRUTH, 0.5)
    log_mesh(stream, f"{FOLLOWER}/shape/mesh", shapes.multirotor(rotors), palette.OWN_COLOUR)
    for k, hub in enumerate(shapes.hubs(rotors) if rotors else ()):
        log_mesh(stream, f"{WEAK}/{k}/disc", shapes.disc(hub, 1.1 * shapes.DISC_RADIUS, 0.03), palette.RED)
    stream.log(f"{FOLLOWER}/shape", rr.Transform3D(scale=FOLLOWER_SPAN), static=True)
    for entity in (FOLLOWER, f"{FOLLOWER}/shape", CAMERA, LEADER_PATH, ENLARGED):
        # the viewer draws axes for entities that are only a pose
        stream.log(entity, rr.TransformAxes3D(axis_length=0.0), static=True)
    for entity, colour in ((LEADER_VELOCITY, palette.ESTIMATE), (OWN_VELOCITY_PATH, palette.OWN_COLOUR)):
        arrow = rr.Arrows3D(vectors=[(1, 0, 0)], colors=colour, radii=rr.Radius.ui_points(1.2))
        stream.log(f"{entity}/arrow", arrow, static=True)
    ball = rr.Ellipsoids3D.from_fields(
        colors=(*palette.UNCERTAIN[:3], 120),
        fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
        line_radii=rr.Radius.ui_points(0.6),
    )
    stream.log(f"{UNCERTAINTY}/ellipsoid", ball, static=True)
    log_lines(stream, f"{GRID_PATH}/lines", shapes.grid(GRID_SPACING, 8), palette.GRID_COLOUR, 0.5)
    colours = {"own": palette.OWN_COLOUR, "estimate": palette.ESTIMATE, "truth": palette.TRUTH}
    for name, entity in TRAILS.items():
        width = rr.Radius.ui_points(0.6 if name == "truth" else 1.2)
        stream.log(entity, rr.LineStrips3D.from_fields(colors=colours[name], radii=width), static=True)
    for entity in OPEN_ENDS:
        log_lines(stream, f"{entity}/outline", shapes.aeroplane_outline(), palette.UNCERTAIN, 1.0)
        stream.log(entity, rr.TransformAxes3D(axis_length=0.0), static=True)
    wide = rr.LineStrips3D.from_fields(colors=palette.UNCERTAIN, radii=rr.Radius.ui_points(3.0))
    stream.log(OPEN_RANGE, wide, static=True)
    for entity, colour in ((SIGHT_LINE, palette.FAINT), (DROP_LINE, palette.ESTIMATE)):
        stream.log(entity, rr.LineStrips3D.from_fields(colors=colour, radii=rr.Radius.ui_points(0.6)), static=True)
    for entity in (TAG, OWN_TAG):
        stream.log(entity, rr.Points3D.from_fields(radii=0.0, show_labels=True), static=True)


def log_rotors(stream: "rr.RecordingStream", rotors: Rotors) -> None:
    """Log our vehicle from above, nose up, with a circle for each rotor."""
    places = np.array([(y, -x) for x, y in shapes.hubs(rotors)]) if rotors else np.zeros((0, 2))
    log_frame(stream, f"{ROTORS_PATH}/arms", [[(0.0, 0.0), (x, y)] for x, y in places.tolist()], 2.0)
    log_frame(stream, f"{ROTORS_PATH}/nose", [[(-0.06, -0.14), (0.0, -0.24), (0.06, -0.14)]], 2.0)
    discs = rr.Points2D.from_fields(positions=places, radii=shapes.DISC_RADIUS, show_labels=True, draw_order=30.0)
    stream.log(f"{ROTORS_PATH}/discs", discs, static=True)
    words = rr.Points2D.from_fields(radii=0.0, show_labels=True, draw_order=50.0)
    stream.log(f"{ROTORS_PATH}/words", words, static=True)


def log_banner(stream: "rr.RecordingStream") -> None:
    """Log bars across the top in the colours of the states, and the headlines on them."""
    for banner in (BANNER, OWN_BANNER):
        stream.log(f"{banner}/bar", rr.LineStrips2D([[(-4000, 0), (4000, 0)]], radii=40.0), static=True)
        words = rr.Points2D.from_fields(radii=0.0, show_labels=True, draw_order=50.0)
        stream.log(f"{banner}/words", words, static=True)


def log_static(stream: "rr.RecordingStream", camera: Camera, rotors: Rotors = ()) -> None:
    """Log everything that does not change; `rotors` are our vehicle's, none if unknown."""
    for entity in (SCENE, HEADING, AROUND_LEADER):
        stream.log(entity, rr.ViewCoordinates.FRD, static=True)
    log_aircraft(stream, rotors)
    log_rotors(stream, rotors)
    log_camera(stream, camera)
    log_image_styles(stream)
    log_banner(stream)
    log_plots(stream)
