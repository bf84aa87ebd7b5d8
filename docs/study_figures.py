"""The figures of each study in the documents, from the JSON of `onboard study`."""

import re
from typing import Any

Json = dict[str, Any]
Figures = dict[str, str]

VARIANTS = ("a", "b", "c", "d", "e", "f1.3", "f0.7", "g", "g-known", "h", "i", "k30", "k45", "k60", "hover")
# the study of Oh & Johnson: its rows that are shown, by variant and method, and how their keys end
RELATIVE_MOTION = {
    **{(v, "shipped"): v.replace(".", "_").replace("-", "_") for v in VARIANTS},
    ("g", "delay"): "g_delay",
    ("hover", "on-wing"): "hover_on_wing",
}


def of_relative_motion(result: Json) -> Figures:
    """Return the figures of the study of Oh & Johnson, a row for each flight of the daemon."""
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
    """Return the figures of the study of our own state, by scenario."""
    accuracy, naming = (table["rows"] for table in result["tables"])
    found = {"own_seeds": str(result["seeds"])}
    for scenario, used, velocity, worst, *_ in accuracy:
        if used == "csvsf-adaptive":
            found[f"{own_key(scenario)}_velocity_m_s"] = f"{velocity:.3f}"
            found[f"{own_key(scenario)}_worst_m_s"] = f"{worst:.2f}"
    for scenario, right, median, longest, *_ in naming:
        if right is not None:
            found[f"{own_key(scenario)}_named_percent"] = f"{right:.0f}"
            found[f"{own_key(scenario)}_delay_median_s"] = f"{median:.2f}"
            found[f"{own_key(scenario)}_delay_longest_s"] = f"{longest:.2f}"
    return found


def own_key(scenario: str) -> str:
    """Return the beginning of a scenario's keys: own_motor for quadrotor-motor.

    That of quadrotor is own_nothing.
    """
    return "own_" + (scenario.removeprefix("quadrotor").lstrip("-") or "nothing").replace("-", "_")


def of_traffic(result: Json) -> Figures:
    """Return the figures of the study of traffic."""
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
    """Return the figures of the study of the closed loop: the worst of all flights."""
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


def of_manoeuvres(result: Json) -> Figures:
    """Return the figures of the study of manoeuvres, a row for each autopilot and manoeuvre."""
    found = {"manoeuvre_flights": str(result["seeds"])}
    for autopilot, name, *numbers in result["tables"][0]["rows"]:
        flights, followed, least, median, greatest, usual, off, farthest, seen, valid, *_ = numbers
        found[f"manoeuvre_{autopilot}_{_key(name)}"] = (
            f"{followed:.0f} of {flights:.0f} | {median:.0f} ({least:.0f}) | {usual:.0f} ({greatest:.0f})"
            f" | {off:.0f} ({farthest:.0f}) | {seen:.0f} | {valid:.0f}"
        )
    return found


def of_encounters(result: Json) -> Figures:
    """Return the figures of the study of encounters, a row for each encounter."""
    found = {"encounters_flights": f"{result['seeds']:.0f}"}
    for name, _, *numbers in result["tables"][0]["rows"]:
        # a family without a valid estimate has none of the others
        valid, _, error, _, _, worst, sigma, inside, inside_error, wrong, wrong_error = (
            "–" if number is None else f"{number:.1f}" for number in numbers
        )
        found["encounters_" + _key(name)] = (
            f"{valid} | {error} ({worst}) | {sigma} | {inside}±{inside_error} | {wrong}±{wrong_error}"
        )
    return found


def _key(encounter: str) -> str:
    return re.sub(r"[,./]", "", encounter).replace(" ", "_")


STUDIES = {
    "relative-motion": of_relative_motion,
    "own-state": of_own_state,
    "traffic": of_traffic,
    "encounters": of_encounters,
    "closed-loop": of_closed_loop,
    "manoeuvres": of_manoeuvres,
}


def of_studies(file: Json) -> Figures:
    """Return the figures of `onboard study --json`, of one study or of all by name."""
    if "study" in file:
        file = {file["study"]: file}
    elif "targets" in file:
        file = {"relative-motion": file}
    found: Figures = {}
    for name, figures in STUDIES.items():
        found |= figures(file[name]) if name in file else {}
    return found
