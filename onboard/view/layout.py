"""The layout of the window, for 1400 x 900. The blueprint is sent with the data."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from onboard.geometry.camera import Camera
from onboard.view import scene, traffic
from onboard.view.columns import TIMELINE
from onboard.view.sdk import rrb
from onboard.view.words import plain

WINDOW_S = 30.0  # of flight in every plot
TRAIL_S = 10.0
BACKGROUND = [18, 20, 23]


class Contents(NamedTuple):
    """Contents of a flight so far, by which its first page is chosen: a leader, our own state, traffic, a present
    threat, a truth, and other vehicles of a fleet."""

    leader: bool = True
    own: bool = False
    traffic: bool = False
    threat: bool = False
    truth: bool = False
    fleet: bool = False


LEADER_ALONE = Contents()

Point = tuple[float, float, float]
Sides = tuple[float, float]


def last(seconds: float) -> "rrb.VisibleTimeRanges":
    """The last seconds up to the time shown."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    end = rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    return rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=start, end=end)])


def time_axis() -> "rrb.TimeAxis":
    """One axis for all plots: the window up to the time shown, and a little room."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-WINDOW_S)
    end = rrb.TimeRangeBoundary.cursor_relative(seconds=0.02 * WINDOW_S)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


def plot(name: str, entity: str, *, legend: bool = False) -> "rrb.TimeSeriesView":
    """A plot of one subtree; all plots share their time axis."""
    return rrb.TimeSeriesView(
        name=name,
        origin=f"/plots/{entity}",
        axis_x=time_axis(),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        time_ranges=last(WINDOW_S),
    )


def flat(name: str, entity: str, x: Sides, y: Sides, *, titlebar: bool = True) -> "rrb.Spatial2DView":
    """A picture of one entity between the sides `x`, left and right, and `y`, above and below."""
    return rrb.Spatial2DView(
        name=name,
        origin=f"/{entity}",
        titlebar=None if titlebar else False,
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=x, y_range=y),
    )


def banner(entity: str = scene.BANNER) -> "rrb.Spatial2DView":
    """A headline, in the colour of the state."""
    return flat("State", entity, (-400.0, 400.0), (-9.0, 31.0), titlebar=False)


def solid(
    name: str, entity: str, contents: Sequence[str], position: Point, target: Point, trails: Iterable[str] = ()
) -> "rrb.Spatial3DView":
    """A scene in the frame of an entity, from `position`, looking at `target` and turning about it; m, z down. Of
    `trails` the last seconds are seen."""
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
        overrides={trail: last(TRAIL_S) for trail in trails},
    )


def chase_view(*, has_leader: bool = True) -> "rrb.Spatial3DView":
    """From behind and above, turning with our heading: the leader stays ahead."""
    # its outline would cover the leader at this distance; the truth has its trail and the close view
    without = [
        *(scene.HEADING, scene.LEADER_TRUTH, scene.TRUE_SIZE, scene.MAGNIFIER),
        *(f"{scene.CAMERA}/{name}" for name in ("verdict", "frame")),
    ]
    drawn = f", leader drawn at {scene.ENLARGEMENT:.0f} times its size" if has_leader else ""
    name = f"Chase view: 10 m grid at our altitude{drawn}"
    contents = [f"+ /{scene.SCENE}/**", *(f"- /{entity}/**" for entity in without)]
    return solid(name, scene.HEADING, contents, (-5.5, -7.5, -10.0), (9.0, 0.0, 0.5), scene.TRAILS.values())


def close_view() -> "rrb.Spatial3DView":
    """The leader by itself: estimate, truth and the ellipsoid between them, and where others place it."""
    entities = (scene.TRUE_SIZE, scene.LEADER_TRUTH, scene.UNCERTAINTY, scene.BESIDE_PATH)
    contents = [f"+ /{entity}/**" for entity in entities]
    return solid("Leader, close", scene.AROUND_LEADER, contents, (-3.5, -2.6, -2.4), (0.0, 0.0, 0.0))


def camera_view(camera: Camera) -> "rrb.Spatial2DView":
    """The camera's image."""
    x, y = (-8.0, camera.width_px + 8.0), (-8.0, 1.54 * camera.height_px + 8.0)
    return flat(f"Camera {plain(camera.name)}, wing x5 below", scene.CAMERA, x, y)


def rotors_view() -> "rrb.Spatial2DView":
    """Our vehicle from above, with its rotors and their faults."""
    return flat("Our rotors", scene.ROTORS_PATH, (-1.0, 1.0), (-0.75, 0.9))


def traffic_view() -> "rrb.Spatial2DView":
    """The map of other aircraft."""
    side = 0.5 * traffic.SHOWN
    name = "Traffic: north up, ways of the next 20 s relative to us"
    return flat(name, traffic.MAP, (-side, side), (-side, side))


def range_plots(others: str) -> list["rrb.TimeSeriesView"]:
    """The leader's range and its error; `others` names the curves of other estimators."""
    return [
        plot(f"Leader: range [m] ±3σ; truth white{others}", "range"),
        plot(f"Leader: error in range [m] ±3σ{others}", "range_error"),
    ]


def overview(shown: Contents, others: str) -> "rrb.Vertical":
    """The leader's position and its consistency."""
    return rrb.Vertical(
        *range_plots(others)[: 2 if shown.truth else 1],
        plot(f"Wingspan of the leader [m], ±3σ{others}", "size"),
        plot("Innovations [σ], gates at ±3", "innovation"),
        name="Overview",
    )


def both(shown: Contents, others: str) -> "rrb.Vertical":
    """The first page with our own state: both estimates and their consistency."""
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
    """One component of our own state, with the autopilot's and the truth."""
    what, unit = (f"velocity {name}", "m/s") if name in scene.AXIS_NAMES else (name, "°")
    return plot(f"Own {what} [{unit}], ±3σ; autopilot amber, truth white", f"own/{name}")


def own(shown: Contents) -> "rrb.Vertical":
    """The first page of a flight without a leader: our own state and its model error."""
    first = own_errors() if shown.truth else [own_plot("north"), own_plot("east")]
    return rrb.Vertical(
        *first,
        *([] if shown.truth else [own_plot("roll")]),
        plot("Own height [m]", "own/height"),
        plot("What the model cannot explain, and quality [%]", "own/trust", legend=True),
        name="Own",
    )


def first_page(shown: Contents, others: str) -> list["rrb.Vertical"]:
    """The page that opens first; none if it is that of traffic."""
    if shown.own:
        return [both(shown, others)] if shown.leader else [own(shown)]
    return []


def plots(shown: Contents, others: str, page: str = "") -> "rrb.Tabs":
    """The first page of what flies, pages of plots for the leader, our own state and the links, and of traffic.
    `page` is open; "": the one of what flies."""
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
            plot("What the model cannot explain, and quality [%]", "own/trust", legend=True),
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
    table = rrb.TextDocumentView(name="The nearest to come", origin=f"/{traffic.TABLE}")
    return rrb.Vertical(traffic_view(), table, name="Traffic", row_shares=[1.3, 1.0])


def below(camera: Camera, shown: Contents) -> "rrb.Horizontal":
    """Below the scene: the image and the leader close up, our rotors, and what is wrong now; of a fleet first the
    table of all."""
    now = rrb.TextDocumentView(name="Now", origin="/status")
    fleet = [rrb.TextDocumentView(name="Fleet", origin="/fleet")] if shown.fleet else []
    rotors = [rotors_view()] if shown.own else []
    if shown.leader or not (shown.own or shown.traffic):
        tabs = [*fleet, *rotors, now]
        corner = rrb.Tabs(*tabs, active_tab=0) if len(tabs) > 1 else now
        return rrb.Horizontal(camera_view(camera), close_view(), corner, column_shares=[1.0, 1.0, 0.95])
    return rrb.Horizontal(*rotors, rrb.Tabs(*fleet, now, active_tab=0) if fleet else now)


def window(camera: Camera, shown: Contents, others: str, page: str = "") -> "rrb.Horizontal":
    """The scene on the left, plots on the right; a headline for what flies."""
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
        time_ranges=last(WINDOW_S),
    )
    right: list[rrb.Container | rrb.View] = [plots(shown, others, page), *([timeline] if strips else [])]
    return rrb.Horizontal(
        rrb.Vertical(*banners, above, below(camera, shown), row_shares=[*([0.13] * len(banners)), 1.6, 1.0]),
        rrb.Vertical(*right, row_shares=[5.2, 0.1 + 0.45 * len(strips)][: len(right)]),
        column_shares=[1.62, 1.0],
    )


def blueprint(
    camera: Camera, shown: Contents = LEADER_ALONE, *, beside: Sequence[tuple[str, str]] = (), page: str = ""
) -> "rrb.Blueprint":
    """The whole window for what a flight has had so far. `beside`: names of other estimators of the leader, and of
    their colours; `page` is open among the plots, "": that of what flies."""
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
