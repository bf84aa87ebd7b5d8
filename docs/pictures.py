"""Draw every picture of the documents again.

    python docs/pictures.py [NAME ...]

The flights are simulated in this process, with the same bytes every time. Pictures of the view need Vulkan (`apt
install mesa-vulkan-drivers`), the plots matplotlib. Without names all are drawn: the drawings, the plots of
errors, the recorded flights, the view's first page for each kind of flight and each of its pages, and the report.
"""

import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import chdir
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import drawings
import error_plots
import real_flights
from PIL import Image, ImageOps

from onboard.commands import cli as onboard
from onboard.commands.demo_flight import flown_beside
from onboard.config import Config, load_config
from onboard.messages import Datagram, TrafficTruth, Truth
from onboard.pipeline import Pipeline
from onboard.view.fleet import Views
from onboard.view.view import View
from onboard.view.viewer import screenshot
from simlink import cli as simlink
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import datagrams

PICTURES: Final = drawings.PICTURES
REPORT_PAGES, REPORT_SCALE, MARGIN = (0, 1, 3), 1.6, 20  # of the PDF: the verdict, the map, the range
HEALTH_PERIOD_NS: Final = 1_000_000_000
PAGES: Final = ("Overview", "Errors", "Motion", "Filter", "Own state", "Links")


class Picture(NamedTuple):
    """A picture of the view: scenario, duration and time shown (s), and the open page."""

    scenario: str
    duration: float
    at: float
    page: str = ""  # "": the default page


VIEWS: Final = {
    "view-both": Picture("mission", 45.0, 40.0),
    "view-own": Picture("quadrotor-motor", 45.0, 40.0),
    "view-leader": Picture("formation-s-turn", 45.0, 40.0),
    "view-hover": Picture("formation-hover", 45.0, 32.0),
    "view-traffic": Picture("traffic", 45.0, 30.0),
    **{f"page-{name.lower().replace(' ', '-')}": Picture("mission", 45.0, 40.0, name) for name in PAGES},
}


@cache
def configured(scenario: str) -> Config:
    """Return a daemon's configuration for a scenario; `formation` also has the paper's filter."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.toml"
        path.write_text(daemon_config(load_scenario(scenario)), encoding="utf-8")
        config = load_config(path, ("link=[]",))
        if scenario != "formation":
            return config
        return load_config(path, ("link=[]", flown_beside("paper", config)))


@cache
def flown(scenario: str, duration: float, seed: int = 1) -> tuple[Any, ...]:
    """Return all records of a flight: estimates, own poses and truths, and a health every second."""
    return tuple(_records(scenario, duration, seed))


def _records(scenario: str, duration: float, seed: int) -> Iterator[Any]:
    pipeline = Pipeline(configured(scenario))
    next_ns = 0
    for item in datagrams(load_scenario(scenario), seed, duration):
        if isinstance(item, Truth | TrafficTruth):
            yield item
        if not isinstance(item, Datagram):
            continue
        yield from pipeline.feed(item)
        if item.t_recv_ns >= next_ns:
            next_ns = item.t_recv_ns + HEALTH_PERIOD_NS
            yield pipeline.health(item.t_recv_ns)


def draw_view(name: str, picture: Picture) -> None:
    """Draw the view of a flight at a time."""
    config = configured(picture.scenario)
    with tempfile.TemporaryDirectory() as folder:
        rrd = Path(folder) / "flight.rrd"
        made: dict[str, Any] = {
            "camera": config.camera_model(),
            "rotors": config.rotors(),
            "open_page": picture.page,
        }
        with View(rrd=rrd, **made) as view:
            for record in flown(picture.scenario, picture.duration):
                view.show(record)
        take(rrd, name, picture.at)


def take(rrd: Path, name: str, at: float) -> None:
    """Take the picture of a recording at a time (s), in 256 colours, a quarter of the bytes."""
    path = PICTURES / f"{name}.png"
    screenshot(rrd, path, at=at)
    Image.open(path).convert("RGB").quantize(256).save(path, optimize=True)


def draw_fleet() -> None:
    """Draw one vehicle of a fleet of two, with the table of both."""
    flights = {"uav-1": flown("mission", 45.0), "uav-2": flown("formation-drop-out", 45.0)}
    config = configured("mission")
    with tempfile.TemporaryDirectory() as folder:
        rrd = Path(folder) / "fleet.rrd"
        with Views(
            camera=config.camera_model(), rotors=config.rotors(), rrd=rrd, spawn=False, apart=True
        ) as views:
            for vehicle, record in by_time(flights):
                views.show(vehicle, record)
        take(rrd.with_name("fleet-uav-1.rrd"), "view-fleet", 36.0)


def draw_report() -> None:
    """Draw the first page of `onboard report` of a simulated flight, with its map and its range.

    It needs pypdfium2.
    """
    from pypdfium2 import PdfDocument  # type: ignore[import-not-found, import-untyped, unused-ignore]  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        Path("formation.toml").write_text(daemon_config(load_scenario("formation")), encoding="utf-8")
        fly = [*("log", "formation", "--seed", "1"), *("--out", "flight.tlog", "--truth", "truth.csv.gz")]
        report = [*("report", "flight.tlog", "--config", "formation.toml"), *("--truth", "truth.csv.gz")]
        if simlink.main(fly) or onboard.main([*report, "--pdf", "flight.pdf"]):
            raise RuntimeError("the flight of the report failed")
        document = PdfDocument("flight.pdf")
        pages = [document[k].render(scale=REPORT_SCALE).to_pil() for k in REPORT_PAGES]
    first, *others = (page.crop(ImageOps.invert(page.convert("L")).getbbox()) for page in pages)
    width = max(other.width for other in others)
    height = max(first.height, sum(other.height for other in others))
    picture = Image.new("RGB", (first.width + width + 3 * MARGIN, height + 2 * MARGIN), "white")
    picture.paste(first, (MARGIN, MARGIN))
    y = MARGIN
    for other in others:
        picture.paste(other, (first.width + 2 * MARGIN, y))
        y += other.height
    picture.quantize(256).save(PICTURES.parent / "report.png", optimize=True)


def by_time(flights: Mapping[str, Iterable[Any]]) -> list[tuple[str, Any]]:
    """Return the records of all vehicles in the order of their flights' times."""
    found = []
    for vehicle, records in flights.items():
        start = None
        newest = 0
        for record in records:
            newest = max(newest, record.t_ns)
            start = newest if start is None and newest > 0 else start
            found.append((newest - (start or newest), vehicle, record))
    return [(vehicle, record) for _, vehicle, record in sorted(found, key=lambda one: one[0])]


def main(names: list[str]) -> None:
    """Draw the pictures of these names, or all."""
    PICTURES.mkdir(exist_ok=True)
    if not names or "drawings" in names:
        drawings.main()
    if not names or "errors" in names:
        error_plots.main(flown)
    if (not names or "real-flights" in names) and not real_flights.main():
        print(f"real-flights: not drawn, {real_flights.DATA} is not here", flush=True)
    for name, picture in VIEWS.items():
        if not names or name in names:
            print(f"{name}: {picture.scenario}", flush=True)
            draw_view(name, picture)
    if not names or "view-fleet" in names:
        draw_fleet()
    if not names or "report" in names:
        draw_report()


if __name__ == "__main__":
    main(sys.argv[1:])
