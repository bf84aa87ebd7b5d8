"""The live view: a Rerun recording of the records, sent to a viewer, a file, or both."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from onboard import UserError
from onboard.geometry.camera import Camera
from onboard.messages import Estimate, Health, Lifecycle, NavState, OwnPose, Picture, ThreatLevel, Truth
from onboard.units import NS_PER_S
from onboard.view import beside, image, own, palette, plots, scene, space, traffic, words
from onboard.view.columns import HIDDEN, Columns, ImagePoints, colours_2d, labels, pictures, texts, transforms
from onboard.view.layout import LEADER_ALONE, blueprint
from onboard.view.memory import STATUS_RATE_HZ, Memory
from onboard.view.motion import LeaderArrays, leader_state
from onboard.view.sdk import rr
from onboard.view.viewer import free_port, start_viewer, start_web_viewer

BATCH_PERIOD_NS = 200_000_000  # of flight, for a viewer
PLOT_PERIOD = 3  # batches
FILE_BATCH_PERIOD_NS = 2 * NS_PER_S  # for a file without viewer: a tenth of the overhead

STATUS_TIMEOUT_NS = NS_PER_S
LEADER, TRAFFIC = "leader", "traffic"
APPLICATION = "onboard"
MEMORY_LIMIT = "256MiB"  # of the server's buffer for viewers that connect later
THREAT_HOLD_TIME_NS = 10 * NS_PER_S  # the page of traffic stays open after a threat
MIN_REBOOT_STEP_NS = 5 * NS_PER_S  # a time that far back is another boot, not a late record


class View:
    """Draws records as they arrive; not for the daemon's own process, since Rerun may block.

    `rrd` names a recording to write. `grpc_port` is a port on 127.0.0.1 to serve viewers from (0: any free one).
    `spawn` opens the packaged viewer if there is a display; `web` serves it to browsers of this computer instead,
    at the address `page`. `server` is the `url` of another view, which serves this one as well, as a recording
    with its own `name`. `rotors` are those of our vehicle, if known. `open_page` is the open page of plots; ""
    chooses it by the contents.

    Raises `ValueError` without any of `rrd`, `grpc_port`, `spawn`, `web` and `server`, `OSError` if the port is
    taken, UserError if `rrd` cannot be written.
    """

    def __init__(
        self,
        *,
        camera: Camera,
        rrd: Path | None = None,
        grpc_port: int | None = None,
        spawn: bool = False,
        web: bool = False,
        server: str | None = None,
        name: str | None = None,
        rotors: scene.Rotors = (),
        open_page: str = "",
    ) -> None:
        if rrd is None and grpc_port is None and server is None and not (spawn or web):
            raise ValueError("a view needs an output: rrd, grpc_port, spawn, web or server")
        self._camera, self._rotors = camera, rotors
        self._open_page = open_page
        self._shown = LEADER_ALONE._replace(leader=False)
        self._threat_ns = -THREAT_HOLD_TIME_NS
        self._beside: list[str] = []  # other estimators of the leader
        self._columns, self._memory = Columns(), Memory()
        self._t_first_ns: int | None = None
        self._t_flush_ns = 0
        self._flushes = 0
        self._t_newest_ns = 0
        self._closed = False
        self.url: str | None = None
        self.viewer: subprocess.Popen[bytes] | None = None
        sinks: list[rr.GrpcServerSink | rr.GrpcSink | rr.FileSink] = []
        if rrd is not None:
            rrd.parent.mkdir(parents=True, exist_ok=True)
            sinks.append(rr.FileSink(os.fspath(rrd)))
        if server is not None:
            self.url = server
            sinks.append(rr.GrpcSink(server))
        elif grpc_port is not None or spawn or web:
            # 127.0.0.1 and nothing else: what Rerun serves, anybody who reaches the port may read
            ours = rr.GrpcServerSink("127.0.0.1", free_port(grpc_port or 0), server_memory_limit=MEMORY_LIMIT)
            self.url = str(ours.uri)
            sinks.append(ours)
        self._batch_ns = FILE_BATCH_PERIOD_NS if self.url is None else BATCH_PERIOD_NS
        self._stream = rr.RecordingStream(APPLICATION)
        self._rrd = rrd
        with self._file_errors():
            self._stream.set_sinks(*sinks, default_blueprint=blueprint(camera))
        if name is not None:
            self._stream.send_recording_name(name)
        scene.log_static(self._stream, camera, rotors)
        traffic.log_static(self._stream)
        self.page = ""
        if web and server is None and self.url is not None:
            self.viewer, self.page = start_web_viewer(self.url)
        elif spawn and server is None and self.url is not None:
            self.viewer = start_viewer(self.url)

    def show(self, record: Estimate | OwnPose | Truth | Health | Picture) -> None:
        """Draw one record; other kinds and estimators are ignored. Raises `ValueError` once closed."""
        if self._closed:
            raise ValueError("this view is closed")
        if not isinstance(record, Estimate | OwnPose | Truth | Health | Picture):
            return
        if record.t_ns <= 0:
            return  # no boot time is known yet, and the recording would begin at 0
        self._t_newest_ns = record.t_ns
        self._advance_time(record.t_ns)
        match record:
            case NavState():
                self._show_own(record)
            case Estimate():
                if record.name == LEADER and record.is_primary:
                    self._show_estimate(record)
                elif record.name == TRAFFIC:
                    self._show_traffic(record)
                    traffic.draw_traffic(self._columns, self._memory, record)
                elif record.is_primary:
                    self._show_beside(record)
            case OwnPose():
                space.draw_own(self._columns, self._memory, record)
                own.plot_autopilot(self._columns, self._memory, record)
            case Truth():
                self._update_contents(truth=True)
                self._memory.truths.append(record)
                space.draw_truth(self._columns, self._memory, record)
                plots.plot_truth(self._columns, record)
                own.plot_truth(self._columns, self._memory, record)
                plots.plot_errors(self._columns, self._memory)
            case Picture():
                self._columns.add(pictures, f"{scene.CAMERA}/picture", record.t_ns, record.jpeg)
            case Health():
                self._show_health(record)

    def close(self) -> None:
        """Send the remaining rows and write the file's index. May be called twice."""
        if self._closed:
            return
        self._closed = True
        try:
            self._columns.flush(self._stream)
            with self._file_errors():
                self._stream.flush(timeout_sec=10.0)
        finally:
            self._stream.disconnect()
            if self.page and self.viewer is not None:  # nobody else closes it
                self.viewer.terminate()
                self.viewer.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextmanager
    def _file_errors(self) -> Iterator[None]:
        """Raise UserError if Rerun reports a failure of its file."""
        try:
            yield
        except RuntimeError as error:
            if self._rrd is None:
                raise
            raise UserError(f"the view cannot be written to {self._rrd}: {error}") from error

    def _advance_time(self, t_ns: int) -> None:
        """Flush once a batch is complete; start over after a reboot of the autopilot."""
        if self._t_first_ns is None or t_ns < self._t_flush_ns - MIN_REBOOT_STEP_NS:
            self._memory = Memory()
            self._t_first_ns = self._t_flush_ns = t_ns
            space.hide_everything(self._columns, t_ns)
        if t_ns - self._t_flush_ns >= self._batch_ns:
            # half of all entities are curves; a delay of two thirds of a second in a curve is not noticed
            self._flushes += 1
            plots_too = self._batch_ns > BATCH_PERIOD_NS or self._flushes % PLOT_PERIOD == 0
            self._columns.flush(self._stream, plots=plots_too)
            self._t_flush_ns = t_ns

    def _show_estimate(self, estimate: Estimate) -> None:
        columns, memory, t_ns = self._columns, self._memory, estimate.t_ns
        leader = leader_state(estimate)
        space.draw_leader(columns, memory, estimate, leader)
        plots.plot_leader(columns, memory, t_ns, leader)
        plots.plot_errors(columns, memory)
        plots.plot_age(columns, estimate)
        plots.plot_state(columns, memory, "track", t_ns, estimate.state)
        report = estimate.measurement
        if report is not None or estimate.state is not Lifecycle.SEARCHING:
            self._update_contents(leader=True)
        if report is not None:
            memory.report, memory.t_image_ns = report, t_ns
            image.draw_image(columns, memory, self._camera, report, leader)
            plots.plot_report(columns, memory, report, self._stream)
            plots.plot_state(columns, memory, "images", t_ns, report.verdict)  # an image may be stamped ahead
        elif t_ns - memory.t_image_ns > image.IMAGE_TIMEOUT_NS:
            image.clear_image(columns, memory, self._camera, t_ns)
            plots.plot_no_image(columns, memory, t_ns)
            plots.plot_state(columns, memory, "images", t_ns, palette.NO_IMAGE_VERDICT)
        is_of_leader = self._shown.leader or not self._shown.own
        if is_of_leader and memory.is_due("status", t_ns, STATUS_RATE_HZ):
            self._show_status(estimate, leader)

    def _show_own(self, state: NavState) -> None:
        """Show our own state; without a leader it has the status panel."""
        self._update_contents(own=True)
        own.show_state(self._columns, self._memory, state, self._rotors)
        if not self._shown.leader and self._memory.is_due("status", state.t_ns, STATUS_RATE_HZ):
            self._columns.add(texts, "status", state.t_ns, words.own_status(state, self._memory.advice))

    def _show_beside(self, estimate: Estimate) -> None:
        """Show another estimator of the leader, from its first state on."""
        leader, name = leader_state(estimate), estimate.name
        if name not in self._beside:
            if leader is None:
                return
            self._beside.append(name)
            beside.log_static(self._stream, name, beside.colour_of(len(self._beside) - 1)[1])
            self._columns.add(transforms, f"{scene.BESIDE_PATH}/{name}", self._t_first_ns or 0, HIDDEN)
            self._arrange()
        beside.draw(self._columns, self._memory, estimate, leader, beside.colour_of(self._beside.index(name))[1])

    def _update_contents(self, **seen: bool) -> None:
        """Rearrange the window when the contents of the flight change."""
        shown = self._shown._replace(**seen)
        if shown != self._shown:
            self._shown = shown
            self._arrange()

    def _show_traffic(self, estimate: Estimate) -> None:
        """Show traffic first while another aircraft will come too close."""
        approach = estimate.intruder.approach if estimate.intruder is not None else None
        if approach is not None and approach.threat is ThreatLevel.HIGH:
            self._threat_ns = estimate.t_ns
        self._update_contents(traffic=True, threat=estimate.t_ns - self._threat_ns < THREAT_HOLD_TIME_NS)

    def show_fleet(self, text: str) -> None:
        """Show a table of all vehicles, as Markdown, at the time of the newest record."""
        self._update_contents(fleet=True)
        self._columns.add(texts, "fleet", max(self._t_newest_ns, 1), text)

    def _arrange(self) -> None:
        """Arrange the window for the present contents."""
        others = tuple((name, beside.colour_of(k)[0]) for k, name in enumerate(self._beside))
        self._stream.send_blueprint(blueprint(self._camera, self._shown, beside=others, page=self._open_page))

    def _show_health(self, health: Health) -> None:
        """Show the health, and its advice if no estimate of a leader arrives."""
        plots.plot_health(self._columns, self._memory, health, self._stream)
        plots.plot_consistency(self._columns, self._memory, health, self._stream)
        self._columns.add(texts, "health", health.t_ns, words.health(health))
        self._memory.advice, self._memory.worst = words.advice(health), words.worst(health)
        if health.t_ns - self._memory.drawn_ns.get("status", 0) > STATUS_TIMEOUT_NS:
            self._columns.add(texts, "status", health.t_ns, self._memory.advice or words.NO_ADVICE)

    def _show_status(self, estimate: Estimate, leader: LeaderArrays | None) -> None:
        """Show the texts: banner, panel, and the leader's tag."""
        columns, t_ns = self._columns, estimate.t_ns
        fresh = t_ns - self._memory.t_image_ns <= image.IMAGE_TIMEOUT_NS
        report = self._memory.report if fresh else None
        columns.add(
            texts, "status", t_ns, words.status(estimate, leader, report, self._memory.error, self._memory.advice)
        )
        line = words.headline(estimate, leader, report, self._memory.worst)
        colour = palette.STATES[estimate.state]
        columns.add(labels, f"{scene.BANNER}/words", t_ns, ImagePoints(np.zeros((1, 2)), colour, line))
        columns.add(colours_2d, f"{scene.BANNER}/bar", t_ns, palette.shade(colour, 0.35))
        if leader is not None:
            space.draw_tag(columns, t_ns, leader, colour, words.tag(estimate, leader))
