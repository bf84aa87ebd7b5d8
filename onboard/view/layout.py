"""How the window opens: what is where, on 1400 x 900. The blueprint goes with the data, so nobody arranges it."""

from onboard.geometry.camera import Camera
from onboard.view import scene
from onboard.view.columns import TIMELINE
from onboard.view.sdk import rrb

WINDOW_S = 30.0  # of flight in every plot and trail


def last(seconds: float) -> "rrb.VisibleTimeRanges":
    """The last seconds up to the time shown."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    end = rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    return rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=start, end=end)])


def plot(name: str, entity: str, *, legend: bool = False) -> "rrb.TimeSeriesView":
    """A plot of one subtree whose time axis runs with the others."""
    return rrb.TimeSeriesView(
        name=name,
        origin=f"/plots/{entity}",
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        time_ranges=last(WINDOW_S),
    )


def chase_view() -> "rrb.Spatial3DView":
    """From behind and above, turning with our nose: the leader stays ahead."""
    return rrb.Spatial3DView(
        name="Chase view: 10 m grid at our altitude, turning with our nose",
        origin=f"/{scene.HEADING}",
        contents=[f"+ /{scene.SCENE}/**", f"- /{scene.CAMERA}/verdict", f"- /{scene.CAMERA}/frame"],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(-13.0, -7.0, -8.0),
            look_target=(11.0, 0.5, -0.5),
            eye_up=(0.0, 0.0, -1.0),
        ),
        line_grid=False,
        background=[18, 20, 23],
        overrides={entity: last(WINDOW_S) for entity in scene.TRAILS.values()},
    )


def camera_view(camera: Camera) -> "rrb.Spatial2DView":
    """The camera's image."""
    return rrb.Spatial2DView(
        name=f"Camera: {camera.name} [px]",
        origin=f"/{scene.CAMERA}",
        background=[18, 20, 23],
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-8.0, camera.width_px + 8.0], y_range=[-8.0, camera.height_px + 8.0]
        ),
    )


def plots() -> "rrb.Tabs":
    """Five pages of plots; the first answers "where is it, and can I believe it"."""
    return rrb.Tabs(
        rrb.Vertical(
            plot("Range [m], ±3σ", "range", legend=True),
            plot("Error in range [m], ±3σ", "range_error"),
            plot("Wingspan of the leader [m], ±3σ", "size"),
            plot("Innovations [σ]", "innovation", legend=True),
            name="Overview",
        ),
        rrb.Vertical(
            *(plot(f"Error {axis} [m], ±3σ", f"error/{axis}") for axis in scene.AXIS_NAMES), name="Errors"
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
            plot("NIS and its gate", "nis", legend=True),
            plot("Age of the last image fused [s]", "age"),
            name="Filter",
        ),
        rrb.Vertical(
            plot("Streams [Hz]", "rate", legend=True),
            rrb.TextDocumentView(name="Health", origin="/health"),
            name="Links",
        ),
        active_tab=0,
    )


def blueprint(camera: Camera) -> "rrb.Blueprint":
    """The whole window."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                chase_view(),
                rrb.Horizontal(
                    camera_view(camera),
                    rrb.TextDocumentView(name="Now", origin="/status"),
                    column_shares=[1.0, 1.0],
                ),
                row_shares=[1.75, 1.0],
            ),
            rrb.Vertical(
                plots(),
                rrb.StateTimelineView(
                    name="Track and images",
                    origin="/strip",
                    time_view=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
                    time_ranges=last(WINDOW_S),
                ),
                row_shares=[5.0, 1.0],
            ),
            column_shares=[1.5, 1.0],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
