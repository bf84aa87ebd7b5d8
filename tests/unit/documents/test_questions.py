"""What the pages say of safety, validity, the default filter and its numbers is what the code does."""

import re

from onboard.autopilot.sent import BY_ITSELF, IN_ANSWER, SENT_COMMANDS, WHERE_NAMED
from onboard.compiled.sources import imported_by
from onboard.estimators.leader.config import Config as Leader
from onboard.pipeline.silence import TIMEOUT_NS
from tests.support import documents
from tests.support.growth import sets_valid, takes_valid
from tests.support.one_image import way_of_one_image

CODE = re.compile(r"`(onboard/[^`]*\.py)`")
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
NUMBERS += ("thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen", "twenty")


def test_what_is_sent_is_the_table_of_the_code() -> None:
    (table,) = documents.tables(documents.section("published", "What is sent to the autopilot"))
    groups = {"by itself": BY_ITSELF, "in answer": IN_ANSWER, "where named": WHERE_NAMED}
    wanted = [[", ".join(names), occasion] for occasion, group in groups.items() for names in group.values()]
    assert [row[:2] for row in table] == wanted
    (commands,) = [when for name, _, when in table if name == "COMMAND_LONG"]
    assert set(re.findall(r"MAV_CMD_\w+", commands)) == set(SENT_COMMANDS.values())


def test_the_readme_names_all_that_is_sent_unasked() -> None:
    (safety,) = re.findall(r"\*\*Safety\.\*\*.*?\n\n", documents.text(documents.ALL[0]), re.DOTALL)
    for names in BY_ITSELF.values():
        assert set(names) <= set(re.findall(r"[A-Z_]+", safety))


def test_every_file_that_decides_valid_is_named_and_no_other() -> None:
    text = documents.section("architecture", "What decides `valid`")
    firsts = [cells[1] for cells in documents.tables(text)[0]]
    others = [cells[0] for cells in documents.tables(text)[1]]
    named = {file for cell in (*firsts, *others) for file in CODE.findall(cell)}
    deciding = sets_valid().keys() | takes_valid()
    assert deciding <= named
    assert [file for file in named - deciding if "/estimators/leader/" not in file] == []


def test_the_times_after_which_nothing_is_valid_are_the_defaults() -> None:
    text = documents.section("architecture", "What decides `valid`")
    assert f"`validity_timeout_s` ({Leader().validity_timeout_s:g} s)" in text
    assert f"no own motion for {TIMEOUT_NS / 1e9:g} s" in text


def test_an_image_goes_through_the_files_of_the_filter() -> None:
    """Its constants may stand in a file that one of these imports."""
    way = way_of_one_image()
    imported = {name for file in way.files for name in imported_by(file[:-3].replace("/", "."), at_once=True)}
    named = set(CODE.findall(prediction_row()))
    assert named <= way.files | {f"{name.replace('.', '/')}.py" for name in imported}


def prediction_row() -> str:
    """Where the page says that the leader's filter predicts and updates."""
    table, *_ = documents.tables(documents.section("architecture", "Where is ...?"))
    (place,) = (place for what, place in table if what == "the leader's prediction and update")
    return place


def test_the_components_are_counted() -> None:
    count = len(way_of_one_image().estimate.components)
    (written,) = re.findall(r"^(\w+) components are published", documents.text("estimators/leader"), re.MULTILINE)
    assert written.lower() == NUMBERS[count]
    names = documents.names(documents.section("estimators/leader", "What is estimated"))
    assert set(way_of_one_image().estimate.components) <= set(names)
