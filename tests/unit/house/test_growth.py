"""What grows unseen has a limit. A limit is what there is today: whoever needs more takes something away first, or
says in the commit why not; whoever needs less lowers it."""

import pytest

from tests.support import growth
from tests.support.one_image import way_of_one_image
from tests.support.programs import ROOT

MOST_CALLS = 16  # upon each other, from `Pipeline.feed` with an image to the deepest function of ours
MOST_FILES = 47  # of ours that an image passes
MOST_STAYS = 214  # how often an image enters a file of ours
MOST_CALLS_IN_ALL = 233  # of our functions, by an image
MOST_CODE = {".": 36_121, "estimators/leader": 4_041}  # lines that are neither empty, comments nor docstrings
MOST_PLACES = 8  # that set `valid`
MOST_NAMES_OF_TWO = 11  # of classes in `onboard`, each with one meaning in each package
MOST_ARGUMENTS, MOST_OF_KERNELS = 10, 12
MOST_NUMBERS = {"leader": 211, "oh_johnson": 13, "own_state": 103, "traffic": 79}
MOST_STATE_VECTORS = {"leader": 3, "oh_johnson": 1, "own_state": 2, "traffic": 3}
# A folder of `estimators` is a package of its own: each has an Estimator and its Config.
PACKAGES = (
    *(
        "analysis",
        "autopilot",
        "clocks",
        "commands",
        "config",
        "filters",
        "geometry",
        "health",
        "links",
        "messages",
        "models",
        "ownship",
    ),
    *("pipeline", "scoring", "sinks", "terminal", "view", "wire", "estimators/leader", "estimators/oh_johnson"),
    "estimators/own_state",
    *("estimators/traffic", "../simlink/encounters", "../simlink/scenarios", "../simlink/sensors"),
    *("../simlink/server", "../simlink/traffic", "../simlink/world", "../studies/report", "../studies/tracking"),
)


def test_an_image_does_not_fall_deeper() -> None:
    way = way_of_one_image()
    assert len(way.deepest) <= MOST_CALLS, "\n".join(f"{file}: {name}" for file, name in way.deepest)
    assert len(way.files) <= MOST_FILES, sorted(way.files)
    assert way.stays <= MOST_STAYS
    assert way.calls <= MOST_CALLS_IN_ALL


@pytest.mark.parametrize("package", MOST_CODE)
def test_a_package_has_few_lines_of_code(package: str) -> None:
    assert growth.lines_of_code(ROOT / "onboard" / package) <= MOST_CODE[package]


def test_valid_is_set_at_few_places() -> None:
    assert growth.sets_valid().total() <= MOST_PLACES, growth.sets_valid()


def test_functions_take_few_arguments() -> None:
    long = {f.name: f.arguments for f in growth.functions() if not f.is_kernel and f.arguments > MOST_ARGUMENTS}
    assert long == {}
    assert max(f.arguments for f in growth.functions() if f.is_kernel) <= MOST_OF_KERNELS


def test_only_kernels_are_without_types() -> None:
    """mypy lets their modules pass."""
    untyped = {f.name for f in growth.functions() if not f.is_typed and f.name.startswith("onboard/")}
    kernels = {f.name for f in growth.functions() if f.is_kernel}
    assert untyped <= kernels
    assert len(untyped) > 100


@pytest.mark.parametrize("estimator", MOST_NUMBERS)
def test_an_estimator_believes_by_few_numbers(estimator: str) -> None:
    assert growth.numbers(estimator) <= MOST_NUMBERS[estimator]


@pytest.mark.parametrize("estimator", MOST_STATE_VECTORS)
def test_an_estimator_has_few_state_vectors(estimator: str) -> None:
    found = growth.state_vectors(estimator)
    assert len(found) <= MOST_STATE_VECTORS[estimator], sorted(found)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_of_a_class_means_one_thing_in_a_package(package: str) -> None:
    assert growth.names_of_two(ROOT / "onboard" / package) == {}


def test_few_names_of_classes_mean_two_things_in_onboard() -> None:
    found = growth.names_of_two(ROOT / "onboard")
    assert len(found) <= MOST_NAMES_OF_TWO, found
