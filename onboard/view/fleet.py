"""Several vehicles in one viewer, each as a recording in the viewer's list."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from onboard.geometry.camera import Camera
from onboard.messages import Estimate, Health, NavState
from onboard.view import words
from onboard.view.scene import Rotors
from onboard.view.view import View

MAX_VEHICLES: Final = 50  # drawn; further ones are ignored


class Views:
    """A view for each vehicle, created with its first record.

    With `apart`, each has a name and its own file, FILE-vehicle.rrd. Otherwise there is one vehicle, whose view
    exists from the start.
    """

    def __init__(
        self,
        *,
        camera: Camera,
        rrd: Path | None,
        spawn: bool,
        apart: bool,
        web: bool = False,
        rotors: Rotors = (),
    ) -> None:
        self._made_with: dict[str, Any] = {"camera": camera, "rotors": rotors, "spawn": spawn, "web": web}
        self._rrd = rrd
        self._views: dict[str, View] = {}
        self._vehicles: dict[str, words.VehicleRecords] = {}
        self._closing = ExitStack()
        self._only = None
        if not apart:
            self._only = self._closing.enter_context(View(rrd=rrd, **self._made_with))

    def show(self, vehicle: str, record: Any) -> None:
        """Draw a record of a vehicle."""
        view = self._only or self._views.get(vehicle)
        if view is None and len(self._views) < MAX_VEHICLES:
            view = self._views[vehicle] = self._closing.enter_context(self._open(vehicle))
        if view is not None:
            view.show(record)
        if self._only is None:
            self._show_all(vehicle, record)

    def _show_all(self, vehicle: str, record: Any) -> None:
        """Update the table of all vehicles in each view with every health, for two or more vehicles."""
        known = self._vehicles.get(vehicle, words.VehicleRecords())
        if isinstance(record, NavState):
            self._vehicles[vehicle] = known._replace(own=record)
        elif isinstance(record, Estimate) and record.name == "leader" and record.is_primary:
            self._vehicles[vehicle] = known._replace(leader=record)
        elif isinstance(record, Health):
            self._vehicles[vehicle] = known._replace(health=record)
            if len(self._views) > 1 and (view := self._views.get(vehicle)) is not None:
                view.show_fleet(words.fleet(self._vehicles))

    @property
    def page(self) -> str:
        """The address of the served page, "" before there is one."""
        return next((view.page for view in (self._only, *self._views.values()) if view and view.page), "")

    def is_closed_by_user(self) -> bool:
        """Whether the window was opened and closed again."""
        viewers = [view.viewer for view in (self._only, *self._views.values()) if view and view.viewer]
        return bool(viewers) and all(viewer.poll() is not None for viewer in viewers)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.close()  # the first last, since it serves the others

    def _open(self, vehicle: str) -> View:
        rrd = None if self._rrd is None else self._rrd.with_name(f"{self._rrd.stem}-{vehicle}{self._rrd.suffix}")
        server = next((view.url for view in self._views.values()), None)
        return View(rrd=rrd, server=server, name=vehicle, **self._made_with)
