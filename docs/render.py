"""Bring measured figures and generated parts of the documents up to date.

    python docs/render.py                    README's table and docs/published.md, from what is known
    python docs/render.py --score score.json --replay replay.json --studies study.json --bench bench.json

docs/figures.json holds every measured figure by its key, as it is shown. "measured" is written here, from the
JSON files of the commands in docs/measurements.md; "noted" is written by hand, for what no command writes to JSON.
The pages name figures as {{ key }}, and Sphinx puts them in. Several files of `make bench` give the range they
span.
"""

import argparse
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from onboard.messages import schemas

DOCS = Path(__file__).parent
FIGURES = DOCS / "figures.json"
README = DOCS.parent / "README.md"
PUBLISHED = DOCS / "published.md"
Json = dict[str, Any]
Figures = dict[str, str]

README_TABLE = """\
| what | measured with | result (RMS) |
|---|---|---|
| leader, simulated flight | `onboard demo --headless --duration 60 --seed 1` | range {demo_range_percent} %, \
position {demo_position_m} m at {demo_distance_m} m, velocity {demo_velocity_m_s} m/s; \
{demo_inside_percent} % of true positions inside the 95 % ellipsoid |
| leader, MAVLink stream of an ArduPilot, simulated camera | `onboard replay`, [251 s](docs/measurements.md) | \
range {copter_range_percent} %, position {copter_position_m} m at {copter_distance_m} m, \
velocity {copter_velocity_m_s} m/s; {copter_inside_percent} % inside |
| own state, one motor at 75 % | `onboard study own-state --seeds {own_seeds}` | velocity \
{own_motor_velocity_m_s} m/s; fault named within 1 s in {own_motor_named_percent} % of flights, after \
{own_motor_delay_median_s} s (median) |
| traffic, 20 aircraft, {traffic_minutes} minutes | `onboard study traffic --seeds {traffic_seeds}` | \
{traffic_swaps} tracks changed aircraft; 95 % ellipsoids hold {traffic_inside_percent} % of the truth |
| 100 leaders at 30 images a second | `make bench` | {bench_leaders_cores} cores |
| one step of a nine-state unscented filter | `make bench` | {bench_radar_us} µs; filterpy takes \
{bench_radar_filterpy} times as long |"""

SCORE = {
    "range_percent": ("range_error_rms_percent", ".1f"),
    "position_m": ("position_rmse_m", ".2f"),
    "velocity_m_s": ("velocity_rmse_m_s", ".2f"),
    "nis": ("nis_mean", ".2f"),
    "nis_dof": ("nis_dof", "d"),
    "inside_percent": ("inside_95_percent", ".0f"),
}
VARIANTS = ("a", "b", "c", "d", "e", "f1.3", "f0.7", "g", "g-known", "h", "i", "k30", "k45", "k60", "hover")
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
}


# the study of Oh & Johnson: its rows that are shown, by variant and method, and how their keys end
RELATIVE_MOTION = {
    **{(v, "shipped"): v.replace(".", "_").replace("-", "_") for v in VARIANTS},
    ("g", "delay"): "g_delay",
    ("hover", "on-wing"): "hover_on_wing",
}


def two_calls_filterpy(radar: Json) -> float:
    """How many times as long filterpy takes as our prediction and update in two calls."""
    return float(radar["times_faster_than_filterpy"] * radar["us"] / radar["us_in_two_calls"])


def of_score(name: str, score: Json) -> Figures:
    """Figures of a scorecard, under keys that begin with `name`."""
    return {f"{name}_{key}": format(score[path], shown) for key, (path, shown) in SCORE.items()}


def of_bench(runs: Sequence[Json]) -> Figures:
    """Figures of one or several runs of `make bench`: a value, or the range of values."""
    found = {}
    for key, (value, shown) in BENCH.items():
        low, high = format(min(map(value, runs)), shown), format(max(map(value, runs)), shown)
        found[f"bench_{key}"] = low if low == high else f"{low} to {high}"
    return found


def of_live(history: str) -> Figures:
    """Figures of the newest line of `benchmarks/history.jsonl`."""
    live: Json = json.loads(history.splitlines()[-1])
    found = {
        "live_date": live["machine"]["date"],
        "live_cpu": live["machine"]["cpu"],
        "live_cores": str(live["machine"]["cores"]),
        "live_load_average": f"{live['machine']['load_average']:.1f}",
        "live_start_s": f"{live['start']['warm_s']:.1f}",
        "live_replay_times": f"{live['stages']['replay_times']:.0f}",
        "live_most_per_s": f"{most_without_a_drop(live['input']):,}",
    }
    for key in ("read", "decode", "align", "estimate", "encode"):
        found[f"live_{key}_us"] = f"{live['stages'][f'{key}_us']:.1f}"
    for key, short in (("alone", "alone"), ("beside_two_busy_loops", "busy"), ("half_of_one_core", "half")):
        flown = live[key]
        for what, value in flown["arrival_ms"].items():
            found[f"live_{short}_arrival_{what}_ms"] = f"{value:.1f}"
        found[f"live_{short}_cpu_percent"] = f"{flown['cpu_percent']:.0f}"
        found[f"live_{short}_memory_mb"] = f"{flown['memory_mb']:.0f}"
    alone = live["alone"]
    found["live_alone_answered"] = f"{alone['answered']} of {alone['images']}"
    for what, value in alone["exposure_ms"].items():
        found[f"live_alone_exposure_{what}_ms"] = f"{value:.1f}"
    for row in live["input"]:
        found[f"live_{row['asked']}_sent"] = f"{row['sent_per_s']:,.0f}"
        found[f"live_{row['asked']}_dropped"] = f"{100 * row['dropped'] / max(row['sent'], 1):.1f}"
        found[f"live_{row['asked']}_us"] = f"{row['cpu_us_per_message']:.0f}"
    return found


def most_without_a_drop(rows: Sequence[Json]) -> int:
    """The highest rate (messages a second) up to which nothing was dropped or shed; 0 if there is none."""
    most = 0
    for row in rows:
        if row["dropped"] or row["received"] < row["sent"]:
            break
        most = int(row["asked"])
    return most


def of_relative_motion(result: Json) -> Figures:
    """Figures of the study of Oh & Johnson: a row of the page's table for each flight of the daemon."""
    found = {}
    for row in result["rows"]:
        name = RELATIVE_MOTION.get((row["variant"], row["method"]))
        if name is None:
            continue
        values = {key: quantity["value"] for key, quantity in row["quantities"].items()}
        shown = (
            *((values["range_percent"], ".1f"), (row["position_m"], ".2f"), (row["velocity_m_s"], ".2f")),
            *((values[key], ".1f") for key in ("nees", "inside_percent", "valid_percent")),
        )
        found["relative_motion_runs"] = str(row["runs"])
        found[f"relative_motion_{name}"] = " | ".join("–" if x is None else format(x, how) for x, how in shown)
        if name == "a":
            found["steady_turn_nees"] = format(values["nees"], ".1f")
    return found


def of_own_state(result: Json) -> Figures:
    """Figures of the study of our own state, by scenario."""
    accuracy, naming = (table["rows"] for table in result["tables"])
    found = {"own_seeds": str(result["seeds"])}
    for scenario, used, velocity, worst, *_ in accuracy:
        kind = {"csvsf-adaptive": "", "csvsf-adaptive, no barometer": "_no_barometer"}.get(used)
        if kind is not None:
            found[f"{own_key(scenario)}{kind}_velocity_m_s"] = f"{velocity:.3f}"
            found[f"{own_key(scenario)}{kind}_worst_m_s"] = f"{worst:.2f}"
    for scenario, right, median, longest, *_ in naming:
        if right is not None:
            found[f"{own_key(scenario)}_named_percent"] = f"{right:.0f}"
            found[f"{own_key(scenario)}_delay_median_s"] = f"{median:.2f}"
            found[f"{own_key(scenario)}_delay_longest_s"] = f"{longest:.2f}"
    return found


def own_key(scenario: str) -> str:
    """How the keys of a scenario begin: own_motor for quadrotor-motor, own_nothing for quadrotor."""
    return "own_" + (scenario.removeprefix("quadrotor").lstrip("-") or "nothing").replace("-", "_")


def of_traffic(result: Json) -> Figures:
    """Figures of the study of traffic."""
    checks = [check["ours"] for check in result["checks"]]
    aircraft = sorted(result["tables"][0]["rows"], key=lambda row: row[1])
    approaches, good = (sum(row[i] for row in aircraft) for i in (5, 6))
    (least, least_error), (most, most_error) = aircraft[0][1:3], aircraft[-1][1:3]
    return {
        "traffic_seeds": str(result["seeds"]),
        "traffic_minutes": str(3 * result["seeds"]),  # each flight lasts three
        "traffic_swaps": f"{checks[0]:.0f}",
        "traffic_false_tracks": f"{checks[1]:.0f}",
        "traffic_untracked_s": f"{checks[2]:.0f}",
        "traffic_inside_percent": f"{checks[3]:.1f}",
        "traffic_least_inside_percent": f"{least:.1f} ± {least_error:.1f}",
        "traffic_most_inside_percent": f"{most:.1f} ± {most_error:.1f}",
        "traffic_approaches": f"{approaches:.0f}",
        "traffic_approaches_percent": f"{100 * good / approaches:.1f}",
    }


def of_closed_loop(result: Json) -> Figures:
    """Figures of the study of the closed loop: the worst of all flights."""
    straight, worst, least, stop = (check["ours"] for check in result["checks"])
    rows = result["tables"][0]["rows"]
    return {
        "loop_flights": str(result["seeds"]),
        "loop_straight_percent": f"{straight:.1f}",
        "loop_worst_percent": f"{worst:.1f}",
        "loop_rms_percent": f"{max(row[3] for row in rows):.1f}",
        "loop_least_percent": f"{least:.0f}",
        "loop_stop_s": f"{stop:.1f}",
        "loop_greatest_m": f"{max(row[6] for row in rows):.0f}",
        "loop_back_s": f"{max(row[7] for row in rows):.0f}",
    }


def of_encounters(result: Json) -> Figures:
    """Figures of the study of encounters: a row of the page's tables for each encounter."""
    found = of_reference(result) | {"encounters_flights": f"{result['seeds']:.0f}"}
    for name, _, *numbers in result["tables"][0]["rows"]:
        # a family without a valid estimate has none of the others
        valid, _, error, _, _, worst, sigma, inside, inside_error, wrong, wrong_error = (
            "–" if number is None else f"{number:.1f}" for number in numbers
        )
        found["encounters_" + _key(name)] = (
            f"{valid} | {error} ({worst}) | {sigma} | {inside} ± {inside_error} | {wrong} ± {wrong_error}"
        )
    return found


def of_reference(result: Json) -> Figures:
    """Figures of the encounters beside their reference posterior; none where none was flown."""
    found: Figures = {}
    for table in result["tables"][1:]:
        for name, flights, *numbers in table["rows"]:
            ratios, percents = numbers[:3], numbers[3:]
            ratio, least, greatest = ("–" if x is None else f"{x:.2f}" for x in ratios)
            shown = ("–" if x is None else f"{x:.1f}" for x in percents)
            found["reference_flights"] = f"{flights:.0f}"
            found["reference_" + _key(name)] = f"{ratio} ({least} to {greatest}) | " + " | ".join(shown)
    return found


def _key(encounter: str) -> str:
    return encounter.replace(",", "").replace(" ", "_")


STUDIES = {
    "relative-motion": of_relative_motion,
    "own-state": of_own_state,
    "traffic": of_traffic,
    "encounters": of_encounters,
    "closed-loop": of_closed_loop,
}


def of_studies(file: Json) -> Figures:
    """Figures of `onboard study --json`: of one study, or of all by their names."""
    if "study" in file:
        file = {file["study"]: file}
    elif "targets" in file:
        file = {"relative-motion": file}
    found: Figures = {}
    for name, figures in STUDIES.items():
        found |= figures(file[name]) if name in file else {}
    return found


def readme_table(figures: Figures) -> str:
    """The table of README.md."""
    return README_TABLE.format_map(figures)


def between(text: str, marker: str, inside: str) -> str:
    """`text` with what stands between the comments `marker: begin` and `marker: end` replaced."""
    pattern = rf"(<!-- {marker}: begin[^>]*-->\n).*?(<!-- {marker}: end -->)"
    return re.sub(pattern, lambda m: f"{m[1]}{inside}\n{m[2]}", text, count=1, flags=re.DOTALL)


def read(path: Path) -> Json:
    """A JSON file."""
    found: Json = json.loads(path.read_text(encoding="utf-8"))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Take figures from the files given, then write the generated parts."""
    parser = argparse.ArgumentParser(
        prog="python docs/render.py", description="Bring figures and tables up to date."
    )
    parser.add_argument("--score", type=Path, help="of `onboard demo --json`")
    parser.add_argument("--replay", type=Path, help="of `onboard replay --json`, formation-copter")
    parser.add_argument("--studies", type=Path, nargs="+", default=[], help="of `onboard study --json`")
    parser.add_argument("--live", type=Path, help="the history of `make bench`, whose newest line is taken")
    parser.add_argument("--bench", type=Path, nargs="+", default=[], help="of `make bench`")
    given = parser.parse_args(arguments)
    groups = read(FIGURES)
    measured = groups["measured"]
    measured |= of_score("demo", read(given.score)) if given.score else {}
    measured |= of_score("copter", read(given.replay)) if given.replay else {}
    measured |= of_bench([read(path) for path in given.bench]) if given.bench else {}
    measured |= of_live(given.live.read_text(encoding="utf-8")) if given.live else {}
    for path in given.studies:
        measured |= of_studies(read(path))
    FIGURES.write_text(json.dumps(groups, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    for path, marker, inside in (
        (README, "figures", readme_table(groups["noted"] | measured)),
        (PUBLISHED, "schema", schemas.describe().strip()),
    ):
        path.write_text(between(path.read_text(encoding="utf-8"), marker, inside), encoding="utf-8")


if __name__ == "__main__":
    main()
