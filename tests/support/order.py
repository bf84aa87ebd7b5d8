"""The longest test files, as measured, the longest first.

They begin first, so that the workers end together. The order changes nothing but the time it takes.
"""

from typing import Final

LONGEST: Final = (
    "tests/closed_loop/test_scenarios.py",
    "tests/closed_loop/test_demo.py",
    "tests/closed_loop/test_daemon.py",
    "tests/closed_loop/test_demo_mission.py",
    "tests/closed_loop/test_both_estimators.py",
    "tests/unit/estimators/leader/test_broadcast.py",
    "tests/unit/estimators/own_state/test_flights.py",
    "tests/closed_loop/test_guided.py",
    "tests/unit/estimators/own_state/test_estimator.py",
    "tests/properties/test_late_images.py",
    "tests/closed_loop/test_from_any_side.py",
    "tests/conformance/test_methods.py",
    "tests/unit/studies/test_study_encounters_reference.py",
    "tests/unit/models/test_quadrotor_model.py",
    "tests/unit/commands/test_flight_folder.py",
    "tests/unit/estimators/leader/test_without_ids.py",
    "tests/unit/simlink/test_encounters.py",
    "tests/faults/test_matrix.py",
    "tests/unit/simlink/test_quadrotor.py",
    "tests/unit/simlink/test_encounter_families.py",
    "tests/unit/commands/test_evaluate.py",
    "tests/unit/estimators/own_state/test_honesty.py",
    "tests/unit/simlink/test_setpoint_modes.py",
    "tests/faults/test_latching.py",
    "tests/unit/analysis/test_report.py",
    "tests/unit/estimators/own_state/test_planes.py",
    "tests/faults/test_leader_fuzz.py",
    "tests/unit/studies/test_study_interrupted.py",
    "tests/unit/commands/test_cli.py",
    "tests/faults/test_held_up.py",
    "tests/faults/test_wrong_but_valid.py",
    "tests/unit/simlink/test_world.py",
    "tests/conformance/test_estimators.py",
    "tests/unit/estimators/leader/test_honesty.py",
    "tests/faults/test_wall_clock.py",
    "tests/unit/studies/test_study_csvsf_quadrotor.py",
    "tests/faults/test_other_clocks.py",
    "tests/unit/estimators/leader/test_misfits.py",
)


def place(file: str) -> int:
    """Return the place of a file in the order, by its path; unlisted files come last."""
    return LONGEST.index(file) if file in LONGEST else len(LONGEST)
