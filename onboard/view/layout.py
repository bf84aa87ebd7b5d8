"""The layout of the window, for 1400 x 900 px; the blueprint is sent with the data."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from onboard.geometry.camera import Camera
from onboard.view import scene, traffic
from onboard.view.columns import TIMELINE
from onboard.view.sdk import rrb
from onboard.view.words import plain

PLOTTED_TIME_S = 30.0  # of flight in every plot
TRAIL_DURATION_S = 10.0
BACKGROUND = [18, 20, 23]


class Contents(NamedTuple):
    """The contents of a flight so far, which decide the first page."""

    leader: bool = True
    own: bool = False  # our own state
    traffic: bool = False
    threat: bool = False  # of another aircraft, now
    truth: bool = False
    fleet: bool = False  # other vehicles


LEADER_ALONE = Contents()

Point = tuple[float, float, float]
Sides = tuple[float, float]


def last_seconds(seconds: float) -> "rrb.VisibleTimeRanges":
    """Return the time range of the last seconds up to the time shown."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    end = rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    return rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=start, end=end)])


def time_axis() -> "rrb.TimeAxis":
    """Return the common axis of all plots: the window up to the time shown, with a margin."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-PLOTTED_TIME_S)
    end = rrb.TimeRangeBoundary.cursor_relative(seconds=0.02 * PLOTTED_TIME_S)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


def plot(name: str, entity: str, *, legend: bool = False) -> "rrb.TimeSeriesView":
    """A plot of one subtree; all plots share their time axis."""
    return rrb.TimeSeriesView(
        name=name,
        origin=f"/plots/{entity}",
        axis_x=time_axis(),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        time_ranges=last_seconds(PLOTTED_TIME_S),
    )


def view_2d(name: str, entity: str, x: Sides, y: Sides, *, titlebar: bool = True) -> "rrb.Spatial2DView":
    """Return a 2-D view of one entity between the sides `x` (left, right) and `y` (top, bottom)."""
    return rrb.Spatial2DView(
        name=name,
        origin=f"/{entity}",
        titlebar=None if titlebar else False,
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=x, y_range=y),
    )


def banner(entity: str = scene.BANNER) -> "rrb.Spatial2DView":
    """A headline, in the colour of the state."""
    return view_2d("State", entity, (-400.0, 400.0), (-9.0, 31.0), titlebar=False)


def view_3d(
    name: str, entity: str, contents: Sequence[str], position: Point, target: Point, trails: Iterable[str] = ()
) -> "rrb.Spatial3DView":
    """Return a 3-D view in the frame of an entity, seen from `position` and turning about `target`.

    Positions are in m with z down. Of `trails` the last seconds are shown.
    """
    kind = rrb.Eye3DKind.Orbital
    eye = rrb.EyeControls3D(kind=kind, position=position, look_target=target, eye_up=(0.0, 0.0, -1.0))
    return rrb.Spatial3DView(
        name=name,
        origin=f"/{entity}",
        contents=contents,
        eye_controls=eye,
        line_grid=False,
        spatial_information=rrb.SpatialInformation.from_fields(show_axes=False),
        background=BACKGROUND,
        overrides={trail: last_seconds(TRAIL_DURATION_S) for trail in trails},
    )


def chase_view(*, has_leader: bool = True) -> "rrb.Spatial3DView":
    """Return the view from behind and above, which turns with our heading."""
    # its outline would cover the leader at this distance; the truth has its trail and the close view
    without = [
        *(scene.HEADING, scene.LEADER_TRUTH, scene.TRUE_SIZE, scene.MAGNIFIER),
        *(f"{scene.CAMERA}/{name}" for name in ("verdict", "frame")),
    ]
    drawn = f", leader drawn at {scene.LEADER_SCALE:.0f} times its size" if has_leader else ""
    name = f"Chase view: 10 m grid at our altitude{drawn}"
    contents = [f"+ /{scene.SCENE}/**", *(f"- /{entity}/**" for entity in without)]
    return view_3d(name, scene.HEADING, contents, (-5.5, -7.5, -10.0), (9.0, 0.0, 0.5), scene.TRAILS.values())


def close_view() -> "rrb.Spatial3DView":
    """Return the view of the leader alone: estimate, truth, uncertainty, and other estimators."""
    entities = (scene.TRUE_SIZE, scene.LEADER_TRUTH, scene.UNCERTAINTY, scene.BESIDE_PATH)
    contents = [f"+ /{entity}/**" for entity in entities]
    return view_3d("Leader, close", scene.AROUND_LEADER, contents, (-3.5, -2.6, -2.4), (0.0, 0.0, 0.0))


def camera_view(camera: Camera) -> "rrb.Spatial2DView":
    """The camera's image."""
    x, y = (-8.0, camera.width_px + 8.0), (-8.0, 1.54 * camera.height_px + 8.0)
    return view_2d(f"Camera {plain(camera.name)}, wing x5 below", scene.CAMERA, x, y)


def rotors_view() -> "rrb.Spatial2DView":
    """Return the view of our vehicle from above, with its rotors and their faults."""
    return view_2d("Our rotors", scene.ROTORS_PATH, (-1.0, 1.0), (-0.75, 0.9))


def traffic_view() -> "rrb.Spatial2DView":
    """The map of other aircraft."""
    side = 0.5 * traffic.MAP_WIDTH
    name = "Traffic: north up, relative motion of the next 20 s"
    return view_2d(name, traffic.MAP, (-side, side), (-side, side))


def range_plots(others: str) -> list["rrb.TimeSeriesView"]:
    """Return the plots of the leader's range and its error; `others` names further curves."""
    return [
        plot(f"Leader: range [m] ±3σ; truth white{others}", "range"),
        plot(f"Leader: error in range [m] ±3σ{others}", "range_error"),
    ]


def overview(shown: Contents, others: str) -> "rrb.Vertical":
    """Return the page with the leader's position and its consistency."""
    return rrb.Vertical(
        *range_plots(others)[: 2 if shown.truth else 1],
        plot(f"Wingspan of the leader [m], ±3σ{others}", "size"),
        plot("Innovations [σ], gates at ±3", "innovation"),
        name="Overview",
    )


def leader_and_own_page(shown: Contents, others: str) -> "rrb.Vertical":
    """Return the first page with our own state: both estimates and their consistency."""
    mine = own_errors() if shown.truth else [own_plot("north"), own_plot("roll")]
    ours = range_plots(others) if shown.truth else [range_plots(others)[0], plot("Wingspan [m], ±3σ", "size")]
    return rrb.Vertical(*ours, *mine, name="Both")


def own_errors() -> list["rrb.TimeSeriesView"]:
    """Errors of our own state."""
    return [
        plot("Own velocity: error [m/s] ±3σ; north red, east green, down blue", "own/velocity_error"),
        plot("Own attitude: error [°] ±3σ; roll red, pitch green, yaw blue", "own/attitude_error"),
    ]


def own_plot(name: str) -> "rrb.TimeSeriesView":
    """Return the plot of one component of our own state, with the autopilot's and the truth."""
    what, unit = (f"velocity {name}", "m/s") if name in scene.AXIS_NAMES else (name, "°")
    return plot(f"Own {what} [{unit}], ±3σ; autopilot amber, truth white", f"own/{name}")


def own_page(shown: Contents) -> "rrb.Vertical":
    """Return the first page of a flight without a leader: our own state and its model error."""
    first = own_errors() if shown.truth else [own_plot("north"), own_plot("east")]
    return rrb.Vertical(
        *first,
        *([] if shown.truth else [own_plot("roll")]),
        plot("Own height [m]", "own/height"),
        plot("Outside the boundary layer, and quality [%]", "own/trust", legend=True),
        name="Own",
    )


def first_page(shown: Contents, others: str) -> list["rrb.Vertical"]:
    """Return the page that opens first, or none if it is that of traffic."""
    if shown.own:
        return [leader_and_own_page(shown, others)] if shown.leader else [own_page(shown)]
    return []


def plots(shown: Contents, others: str, page: str = "") -> "rrb.Tabs":
    """Return all pages of plots: leader, own state, links, and traffic.

    `page` is the one that is open; "" chooses it by the contents.
    """
    first = first_page(shown, others)
    traffic_first = shown.threat or (shown.traffic and not shown.leader)
    pages = [
        *first,
        overview(shown, others),
        rrb.Vertical(
            *(plot(f"Error {axis} [m], ±3σ{others}", f"error/{axis}") for axis in scene.AXIS_NAMES), name="Errors"
        ),
        rrb.Vertical(
            *(plot(f"Relative velocity {axis} [m/s], ±3σ", f"velocity/{axis}") for axis in scene.AXIS_NAMES),
            *(
                plot(f"Leader's {a} acceleration [m/s²], ±3σ", f"acceleration/{a}")
                for a in ("lateral", "longitudinal")
            ),
            name="Motion",
        ),
        rrb.Vertical(
            plot("Innovations [σ]", "innovation", legend=True),
            plot("NIS over its gate; 3 and more at the top", "nis", legend=True),
            plot("Mean NIS over its expectation, bounds 99.7 %", "consistency", legend=True),
            plot("Age of the last image fused [s]", "age"),
            name="Filter",
        ),
        rrb.Vertical(
            *(own_plot(axis) for axis in scene.AXIS_NAMES),
            *(plot(f"Own {angle} [°]", f"own/{angle}") for angle in ("roll", "pitch", "yaw")),
            plot("Own height [m]", "own/height"),
            plot("Outside the boundary layer, and quality [%]", "own/trust", legend=True),
            name="Own state",
        ),
        rrb.Vertical(
            plot("Streams [Hz]", "rate", legend=True),
            rrb.TextDocumentView(name="Health", origin="/health"),
            name="Links",
        ),
        traffic_page(),
    ]
    names = [one.name for one in pages]
    return rrb.Tabs(*pages, active_tab=names.index(page) if page else (len(first) + 6) * traffic_first)


def traffic_page() -> "rrb.Vertical":
    """The map of other aircraft and the table of the closest approaches."""
    table = rrb.TextDocumentView(name="Closest approaches", origin=f"/{traffic.TRAFFIC_TABLE}")
    return rrb.Vertical(traffic_view(), table, name="Traffic", row_shares=[1.3, 1.0])


def bottom_row(camera: Camera, shown: Contents) -> "rrb.Horizontal":
    """Return the row below the scene: image, leader close up, rotors, advice, and a fleet's table."""
    now = rrb.TextDocumentView(name="Now", origin="/status")
    fleet = [rrb.TextDocumentView(name="Fleet", origin="/fleet")] if shown.fleet else []
    rotors = [rotors_view()] if shown.own else []
    if shown.leader or not (shown.own or shown.traffic):
        tabs = [*fleet, *rotors, now]
        corner = rrb.Tabs(*tabs, active_tab=0) if len(tabs) > 1 else now
        return rrb.Horizontal(camera_view(camera), close_view(), corner, column_shares=[1.0, 1.0, 0.95])
    return rrb.Horizontal(*rotors, rrb.Tabs(*fleet, now, active_tab=0) if fleet else now)


def window(camera: Camera, shown: Contents, others: str, page: str = "") -> "rrb.Horizontal":
    """Return the window: headlines and scene on the left, plots on the right."""
    has_leader = shown.leader or not (shown.own or shown.traffic)
    banners = [*([banner()] if has_leader else []), *([banner(scene.OWN_BANNER)] if shown.own else [])]
    above = traffic_view() if shown.traffic and not has_leader else chase_view(has_leader=has_leader)
    strips = [*(["/track", "/images"] if has_leader else []), *(["/own_state", "/faults"] if shown.own else [])]
    names = [*(["track", "images"] if has_leader else []), *(["own state", "faults"] if shown.own else [])]
    timeline = rrb.StateTimelineView(
        name=", ".join(names).capitalize(),
        origin="/",
        contents=strips,
        time_view=time_axis(),
        time_ranges=last_seconds(PLOTTED_TIME_S),
    )
    right: list[rrb.Container | rrb.View] = [plots(shown, others, page), *([timeline] if strips else [])]
    return rrb.Horizontal(
        rrb.Vertical(*banners, above, bottom_row(camera, shown), row_shares=[*([0.13] * len(banners)), 1.6, 1.0]),
        rrb.Vertical(*right, row_shares=[5.2, 0.1 + 0.45 * len(strips)][: len(right)]),
        column_shares=[1.62, 1.0],
    )


def blueprint(
    camera: Camera, shown: Contents = LEADER_ALONE, *, beside: Sequence[tuple[str, str]] = (), page: str = ""
) -> "rrb.Blueprint":
    """Return the whole window for the contents of a flight so far.

    `beside` lists the names of other estimators of the leader and of their colours. `page` is the open page of
    plots; "" chooses it by the contents.
    """
    others = "".join(f", {plain(name)} {colour}" for name, colour in beside)
    return rrb.Blueprint(
        window(camera, shown, others, page),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
