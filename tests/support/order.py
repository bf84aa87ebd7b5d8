"""The longest test files, as measured, the longest first. They begin first, so that the workers end together. The
order changes nothing but the time it takes."""

from typing import Final

LONGEST: Final = (
    "tests/unit/estimators/own_state/test_flights.py",
    "tests/closed_loop/test_traffic.py",
    "tests/closed_loop/test_scenarios.py",
    "tests/conformance/test_methods.py",
    "tests/unit/estimators/leader/test_honesty.py",
    "tests/faults/test_matrix.py",
    "tests/closed_loop/test_demo.py",
    "tests/closed_loop/test_demo_mission.py",
    "tests/closed_loop/test_daemon.py",
    "tests/unit/models/test_quadrotor_model.py",
    "tests/unit/estimators/own_state/test_estimator.py",
    "tests/unit/estimators/leader/test_without_ids.py",
    "tests/unit/commands/test_compiling.py",
    "tests/unit/estimators/own_state/test_honesty.py",
    "tests/faults/test_wrong_but_valid.py",
    "tests/properties/test_late_images.py",
    "tests/faults/test_wall_clock.py",
    "tests/conformance/test_estimators.py",
    "tests/faults/test_leader_fuzz.py",
    "tests/faults/test_faulty_links.py",
    "tests/unit/estimators/traffic/test_registration.py",
    "tests/unit/simlink/test_quadrotor.py",
    "tests/faults/test_held_up.py",
    "tests/closed_loop/test_from_any_side.py",
    "tests/closed_loop/test_own_state.py",
    "tests/unit/estimators/leader/test_noses.py",
    "tests/unit/studies/test_study_relative_motion.py",
    "tests/faults/test_latching.py",
    "tests/unit/estimators/leader/test_listening.py",
    "tests/unit/estimators/leader/test_lifecycle.py",
    "tests/closed_loop/test_guided.py",
    "tests/unit/commands/test_calibrate.py",
    "tests/unit/house/test_running.py",
    "tests/unit/commands/test_replay_memory.py",
    "tests/unit/studies/test_study_csvsf_quadrotor.py",
)


def place(file: str) -> int:
    """Where a file comes, by its path in the repository: all that are not listed come last."""
    return LONGEST.index(file) if file in LONGEST else len(LONGEST)
