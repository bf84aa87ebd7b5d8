"""Fly a real autopilot behind a leader on courses that are drawn at random.

    python -m tests.peers.fly --autopilot ardupilot --seed 1 --out flights

A plan of one seed has one course of each kind. ARDUCOPTER or PX4 names the autopilot's binary, ONBOARD_CODE the
checkout whose programs fly (this one, if unset). A flight in which the computer did not keep up is void, and flown
again. Each flight keeps a folder: the daemon's recording, logs, truth, rows, STATUSTEXTs.
"""

import argparse
import csv
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard.wire.logs.recording import read_messages
from tests.support.arducopter import Copter
from tests.support.courses import Course, draw_plan
from tests.support.formation_flown import Field, Start, Vehicle, Verdict, field
from tests.support.px4 import Px4

Make = Callable[[Path, int, Start], Vehicle]
VEHICLES: Final[dict[str, Make]] = {"ardupilot": Copter, "px4": Px4}
MAX_VOID: Final = 3  # flights of one course
MAX_FAILED: Final = 2  # attempts of one course, of which the first did not begin
HEAD: Final = (
    "| flight | nearest-farthest m | slot RMS, median m | end m, deg "
    "| in place % | in image % | valid % | late | as asked |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


class Options(NamedTuple):
    """How to fly: the vehicles, and what joins them in the field."""

    make: Make
    out: Path
    join: Callable[[Field], object] = lambda _: None


def fly(course: Course, folder: Path, options: Options) -> Verdict:
    """Fly a course, and keep all of it in a folder. Raises AssertionError or OSError if it did not begin."""
    folder.mkdir(parents=True)
    with field(folder, options.make, course) as world:
        try:
            world.take_off()
            options.join(world)
            world.fly(course)
            return world.judge(course)
        finally:
            _keep(world)


def _keep(world: Field) -> None:
    """Write rows and STATUSTEXTs."""
    (world.folder / "texts.txt").write_text("\n".join(world.follower.texts), encoding="utf-8")
    with (world.folder / "rows.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        names = [f"{name}{axis}" for name in ("r_F_", "v_F_", "r_L_", "v_L_") for axis in "xyz"]
        writer.writerow(["t", *names, "pitch", "heading", "in_view", "distance", "aside", "slot_error"])
        for row in world.rows:
            vectors = [f"{x:.3f}" for v in (row.r_F, row.v_F, row.r_L, row.v_L) for x in v.tolist()]
            rest = (row.pitch, row.heading, row.in_view, row.distance, row.aside, row.slot_error)
            writer.writerow([f"{row.t:.3f}", *vectors, *(f"{float(x):.4f}" for x in rest)])


def valid_ratio(folder: Path) -> float:
    """The share of the leader's states in the recordings of a flight that were valid."""
    valid = count = 0
    for path in folder.glob("flight*.mcap"):
        for message in read_messages(path):
            if message is not None and message[1].topic == "leader":
                count += 1
                valid += bool(msgspec.json.decode(message[2].data)["valid"])
    return valid / max(count, 1)


def describe(course: Course, v: Verdict, valid: float) -> str:
    """A row of the table."""
    answer = "void" if v.is_void else "no: " + ", ".join(v.misses) if v.misses else "yes"
    words = "".join(f'; "{word}"' for word in v.false_words)
    cells = (
        str(course),
        f"{v.min_m:.1f}-{v.max_m:.1f} (>= {v.min_allowed_m:.0f})",
        f"{v.slot_rms_m:.1f}, {v.slot_median_m:.1f}",
        f"{v.end_m:.0f}, {v.end_angle_deg:.0f}",
        f"{100 * v.in_place:.0f}",
        f"{100 * v.in_view:.0f}",
        f"{100 * valid:.0f}",
        f"{100 * v.late:.1f}, stood {v.stood_still}",
        answer + words,
    )
    return f"| {' | '.join(cells)} |"


def fly_plan(plan: list[Course], options: Options) -> int:
    """Fly courses one after another, each until it counts. Returns how many were flown as asked."""
    options.out.mkdir(parents=True)
    print(HEAD, flush=True)
    passed = voids = 0
    for number, course in enumerate(plan, 1):
        failed = void = 0
        while failed < MAX_FAILED and void < MAX_VOID:
            begin = time.monotonic()
            name = f"{number:02d}-{course.kind.replace(' ', '-').replace(',', '')}"
            folder = options.out / f"{name}-{failed + void + 1}"
            try:
                verdict = fly(course, folder, options)
            except Exception as error:  # whatever it was, the next one is flown
                failed += 1
                print(f"| {course} | failed: {error} |", flush=True)
                continue
            row = describe(course, verdict, valid_ratio(folder))
            (folder / "row.txt").write_text(f"{row}\n", encoding="utf-8")
            print(f"{row} <!-- {folder.name}, {time.monotonic() - begin:.0f} s -->", flush=True)
            if not verdict.is_void:
                passed += not verdict.misses
                break
            void += 1
        voids += void
    print(f"{passed} of {len(plan)} as asked; {voids} void", flush=True)
    return passed


def main(arguments: list[str] | None = None, join: Callable[[Field], object] | None = None) -> None:
    """From the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--autopilot", choices=VEHICLES, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, help="only so many of the plan (default: all)")
    parser.add_argument("--only", help="only the kinds of courses with this word")
    parser.add_argument("--out", type=Path, default=Path("out") / "flights")
    parser.add_argument("--nice", type=int, default=0, help="of all programs; below 0 needs privileges")
    a = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
    with suppress(PermissionError):
        os.nice(a.nice)
    plan = [course for course in draw_plan(a.seed) if (a.only or "") in course.kind][: a.flights]
    out = (a.out / f"{a.autopilot}-{a.seed}").resolve()
    shutil.rmtree(out, ignore_errors=True)
    fly_plan(plan, Options(VEHICLES[a.autopilot], out, *([] if join is None else [join])))


if __name__ == "__main__":
    main()
