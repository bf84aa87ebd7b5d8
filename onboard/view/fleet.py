"""Several vehicles in one viewer: a recording each, among which the viewer's list chooses."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from onboard.geometry.camera import Camera
from onboard.view.scene import Rotors
from onboard.view.view import View

MOST: Final = 50  # vehicles that are drawn; further ones are not


class Views:
    """A view for each vehicle, made when its first record comes. With `apart`, each has a name, and a file of its
    own: FILE-vehicle.rrd. Otherwise there is one vehicle, and its view is there from the beginning."""

    def __init__(self, *, camera: Camera, rrd: Path | None, spawn: bool, apart: bool, rotors: Rotors = ()) -> None:
        self._camera, self._rotors, self._rrd, self._spawn = camera, rotors, rrd, spawn
        self._views: dict[str, View] = {}
        self._closing = ExitStack()
        self._only = None
        if not apart:
            self._only = self._closing.enter_context(View(camera=camera, rotors=rotors, rrd=rrd, spawn=spawn))

    def show(self, vehicle: str, record: Any) -> None:
        """Draw a record of a vehicle."""
        view = self._only or self._views.get(vehicle)
        if view is None and len(self._views) < MOST:
            view = self._views[vehicle] = self._closing.enter_context(self._open(vehicle))
        if view is not None:
            view.show(record)

    def is_closed_by_user(self) -> bool:
        """Whether a window was opened, and is closed."""
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
        return View(
            camera=self._camera, rotors=self._rotors, rrd=rrd, spawn=self._spawn, server=server, name=vehicle
        )
