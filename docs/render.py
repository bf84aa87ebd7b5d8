"""Update the measured figures and generated parts of the documents.

    python docs/render.py                    README's table and docs/published.md, from the known figures
    python docs/render.py --score demo.json --replay replay.json --studies study.json --bench bench.json

docs/figures.json holds every measured figure by its key, in the form shown. "measured" is written here, from the
JSON files of the commands in docs/measurements.md; "noted" is written by hand, for figures that no command writes
to JSON. Only figures that a page or README's table shows are kept. A page has a figure as <!--key-->1.9<!--/-->:
comments are not shown, and the text between is written here. No line may begin with one: Markdown takes such a
line as HTML. Several files of `make bench` give a range.
"""

import argparse
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from study_figures import Figures, Json, of_studies

from onboard.messages import schemas

DOCS = Path(__file__).parent
FIGURES = DOCS / "figures.json"
README = DOCS.parent / "README.md"
PUBLISHED = DOCS / "published.md"
PAGES = DOCS
FIGURE = re.compile(r"<!--(\w+)-->(.*?)<!--/-->", re.DOTALL)
TABLE_KEY = re.compile(r"\{(\w+)\}")

README_TABLE = """\
| what | measured on, with | result |
|---|---|---|
| leader and own state, one motor at 75 % from 30 s on | simulated quadrotor, \
`onboard demo --headless --duration 60 --seed 1` | \
leader: valid {mission_valid_percent} % of the time, range {mission_range_percent} %, position \
{mission_position_m} m at {mission_distance_m} m; own state: velocity {mission_own_velocity_m_s} m/s, attitude \
{mission_own_attitude_deg}°; motor named after {mission_fault_after_s} s |
| leader, two fixed wings | simulated, the same with `--scenario formation` | \
range {demo_range_percent} %, position {demo_position_m} m at {demo_distance_m} m, \
velocity {demo_velocity_m_s} m/s; {demo_inside_percent} % of true positions inside the 95 % ellipsoid |
| leader, circles at 12 m/s | a real ArduPilot's stream, 251 s, simulated camera, `onboard replay` | \
range {copter_range_percent} %, position {copter_position_m} m at {copter_distance_m} m, \
velocity {copter_velocity_m_s} m/s; {copter_inside_percent} % inside |
| leader hovers near us | two real ArduPilots' streams, 31 s, simulated camera, `onboard replay` | \
range {hover_range_percent} %; {hover_inside_percent} % inside |
| leaders that strangers flew | 38 encounters of their recorded flights, and 14 with racers; simulated camera, \
`onboard study encounters --leaders-from` | valid 95 % of the time, confidently wrong 0.7 %, inside 98 %; \
racers 31, 14 and 80 % |
| own state, one motor at 75 % | {own_seeds} simulated flights, `onboard study own-state` | velocity \
{own_motor_velocity_m_s} m/s; fault named within 1 s in {own_motor_named_percent} % of flights, after \
{own_motor_delay_median_s} s (median) |
| traffic, 20 aircraft | {traffic_minutes} simulated minutes, `onboard study traffic` | \
{traffic_swaps} tracks changed aircraft; 95 % ellipsoids contain {traffic_inside_percent} % of the truth |
| daemon with one leader, 30 images a second | {live_cores} cores of an {live_cpu}, busy with other work, \
`make bench` | {live_alone_cpu_percent} % of a core, {live_alone_memory_mb} MB; image to estimate \
{live_alone_arrival_p50_ms} ms (p50), {live_alone_arrival_p99_ms} ms (p99) |
| one step of a nine-state unscented filter | the same, `make bench` | {bench_radar_us} µs; filterpy takes \
{bench_radar_filterpy} times as long |"""

SCORE = {
    "range_percent": ("range_error_rms_percent", ".1f"),
    "position_m": ("position_rmse_m", ".2f"),
    "velocity_m_s": ("velocity_rmse_m_s", ".2f"),
    "nis": ("nis_mean", ".2f"),
    "nis_dof": ("nis_dof", "d"),
    "inside_percent": ("inside_95_percent", ".0f"),
}
OWN_SCORE: dict[str, tuple[Callable[[Json], float], str]] = {
    "valid_percent": (lambda s: s["valid_percent"], ".0f"),
    "own_velocity_m_s": (lambda s: s["own_state"]["velocity_rmse_m_s"], ".2f"),
    "own_attitude_deg": (lambda s: s["own_state"]["attitude_rmse_deg"], ".2f"),
    "own_nees": (lambda s: s["own_state"]["nees_mean"], ".1f"),
    "fault_after_s": (lambda s: s["fault"]["after_s"], ".2f"),
}
NOT_MEASURED = "–"
SCORED = {"mission": "mission", "formation": "demo"}  # scenario -> what the keys of its figures begin with
# figure -> where `make bench` has it, and how it is shown
BENCH: dict[str, tuple[Callable[[Json], float], str]] = {
    "radar_us": (lambda b: b["radar_ukf"]["us"], ".1f"),
    "radar_filterpy": (lambda b: b["radar_ukf"]["times_faster_than_filterpy"], ".0f"),
    "radar_stonesoup": (lambda b: b["radar_ukf"]["times_faster_than_stonesoup"], ".0f"),
    "own_model_us": (lambda b: b["radar_ukf_own_model"]["us"], ".1f"),
    "own_model_filterpy": (lambda b: b["radar_ukf_own_model"]["times_faster_than_filterpy"], ".0f"),
    "two_calls_us": (lambda b: b["radar_ukf"]["us_in_two_calls"], ".1f"),
    "two_calls_filterpy": (lambda b: two_calls_filterpy(b["radar_ukf"]), ".0f"),
    "square_root_us": (lambda b: b["square_root"]["us"], ".1f"),
    "vision_us": (lambda b: b["vision_ukf"]["us"], ".1f"),
    "vision_filterpy": (lambda b: b["vision_ukf"]["times_faster_than_filterpy"], ".0f"),
    "batch_radar_us": (lambda b: b["batch_radar"]["us_per_step"], ".1f"),
    "batch_radar_filterpy": (lambda b: b["batch_radar"]["times_faster_than_filterpy"], ".0f"),
    "batch_vision_us": (lambda b: b["batch_ukf"]["us_per_step"], ".1f"),
    "batch_vision_filterpy": (lambda b: b["batch_ukf"]["times_faster_than_filterpy"], ".0f"),
    "leaders_cores": (lambda b: b["leader_targets"]["one_core"], ".1f"),
    "without_id": (lambda b: b["leader_targets"]["without_id"], ".2f"),
}


def two_calls_filterpy(radar: Json) -> float:
    """Return the time of filterpy over that of our prediction and update in two calls."""
    return float(radar["times_faster_than_filterpy"] * radar["us"] / radar["us_in_two_calls"])


def score_figures(name: str, score: Json) -> Figures:
    """Return the figures of a scorecard, under keys that begin with `name`."""
    return {f"{name}_{key}": format(score[path], shown) for key, (path, shown) in SCORE.items()}


def demo_figures(score: Json) -> Figures:
    """Return the figures of a demo of a scenario, also of our own state if it is estimated."""
    name = SCORED[score["scenario"]]
    own = OWN_SCORE if score["own_state"] else {}
    return score_figures(name, score) | {
        f"{name}_{key}": format(value(score), shown) for key, (value, shown) in own.items()
    }


def bench_figures(runs: Sequence[Json]) -> Figures:
    """Return the figures of one or several runs of `make bench`: a value, or its range."""
    found = {}
    for key, (value, shown) in BENCH.items():
        low, high = format(min(map(value, runs)), shown), format(max(map(value, runs)), shown)
        found[f"bench_{key}"] = low if low == high else f"{low} to {high}"
    return found


def live_figures(history: str) -> Figures:
    """Return the figures of the newest line of `benchmarks/history.jsonl`."""
    live: Json = json.loads(history.splitlines()[-1])
    machine, stages, floor = live["machine"], live["stages"], live["floor"]
    found = {
        "live_date": machine["date"],
        "live_cpu": machine["cpu"],
        "live_cores": str(machine["cores"]),
        "live_load_average": f"{machine['load_average']:.1f}",
        "live_start_s": f"{live['start']['warm_s']:.1f}",
        "live_replay_times": f"{stages['replay_times']:.0f}",
    }
    for key in ("read", "decode", "align", "estimate", "encode"):
        found[f"live_{key}_us"] = f"{stages[f'{key}_us']:.1f}"
    alone = live["alone"]
    for what in ("p50", "p99", "max"):
        found[f"live_alone_arrival_{what}_ms"] = format(alone["arrival_ms"][what], ".1f")
        found[f"live_alone_exposure_{what}_ms"] = format(alone["exposure_ms"][what], ".1f")
    found["live_alone_cpu_percent"] = format(alone["cpu_percent"], ".0f")
    found["live_alone_memory_mb"] = format(alone["memory_mb"], ".0f")
    found["live_alone_answered"] = f"{alone['answered']} of {alone['images']}"
    found |= {f"live_floor_arrival_{what}_ms": f"{floor['arrival_ms'][what]:.1f}" for what in ("p50", "p99")}
    for what, shown in (("cpu_percent", ".1f"), ("memory_mb", ".0f"), ("replay_times", ".0f"), ("start_s", ".1f")):
        found[f"live_floor_{what}"] = _shown(floor.get(what), shown)
    for what in ("arrival_p50", "arrival_p99", "cpu", "memory", "replay", "start"):
        found[f"live_ratio_{what}"] = _shown(live["ratios"].get(what), ".1f")
    return found


def _shown(value: float | None, how: str) -> str:
    return NOT_MEASURED if value is None else format(value, how)


def readme_table(figures: Figures) -> str:
    """Return the table of README.md."""
    return README_TABLE.format_map(figures)


def replace_figures(text: str, figures: Figures) -> str:
    """Return the `text` of a page with every figure replaced by that of `figures`.

    Raises KeyError.
    """
    return FIGURE.sub(lambda m: f"<!--{m[1]}-->{figures[m[1]]}<!--/-->", text)


def replace_between(text: str, marker: str, inside: str) -> str:
    """Replace the part of `text` between the comments `marker: begin` and `marker: end`."""
    pattern = rf"(<!-- {marker}: begin[^>]*-->\n).*?(<!-- {marker}: end -->)"
    return re.sub(pattern, lambda m: f"{m[1]}{inside}\n{m[2]}", text, count=1, flags=re.DOTALL)


def shown_keys() -> set[str]:
    """Return the keys of the figures that the pages and README's table show."""
    pages = (path.read_text(encoding="utf-8") for path in PAGES.rglob("*.md"))
    return {match[1] for page in pages for match in FIGURE.finditer(page)} | {*TABLE_KEY.findall(README_TABLE)}


def read(path: Path) -> Json:
    """Read a JSON file."""
    found: Json = json.loads(path.read_text(encoding="utf-8"))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Read figures from the given files, then write the generated parts."""
    parser = argparse.ArgumentParser(
        prog="python docs/render.py", description="Bring figures and tables up to date."
    )
    parser.add_argument("--score", type=Path, nargs="+", default=[], help="of `onboard demo --json`")
    parser.add_argument("--replay", type=Path, help="of `onboard replay --json`, formation-copter")
    parser.add_argument("--studies", type=Path, nargs="+", default=[], help="of `onboard study --json`")
    parser.add_argument("--live", type=Path, help="the history of `make bench`, whose newest line is taken")
    parser.add_argument("--bench", type=Path, nargs="+", default=[], help="of `make bench`")
    given = parser.parse_args(arguments)
    groups = read(FIGURES)
    measured = groups["measured"]
    for path in given.score:
        measured |= demo_figures(read(path))
    measured |= score_figures("copter", read(given.replay)) if given.replay else {}
    measured |= bench_figures([read(path) for path in given.bench]) if given.bench else {}
    measured |= live_figures(given.live.read_text(encoding="utf-8")) if given.live else {}
    for path in given.studies:
        measured |= of_studies(read(path))
    groups["measured"] = measured = {key: shown for key, shown in measured.items() if key in shown_keys()}
    FIGURES.write_text(json.dumps(groups, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    for path, marker, inside in (
        (README, "figures", readme_table(groups["noted"] | measured)),
        (PUBLISHED, "schema", schemas.describe().strip()),
    ):
        path.write_text(replace_between(path.read_text(encoding="utf-8"), marker, inside), encoding="utf-8")
    for path in sorted(PAGES.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        path.write_text(replace_figures(text, groups["noted"] | measured), encoding="utf-8")


if __name__ == "__main__":
    main()
