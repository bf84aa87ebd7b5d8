"""Schemas and tables agree with the records."""

import json

import msgspec
import pytest

from onboard.messages import CameraDetections, SimStatus
from onboard.messages.schemas import PUBLISHED, describe, key_of, schemas
from tests.support.records import make_estimate

OPEN = {CameraDetections}  # detectors send more than we read: what is not known is ignored, and named once


def test_every_published_record_has_a_schema_that_names_its_fields_and_says_what_it_is() -> None:
    found = schemas()
    assert set(found) == set(PUBLISHED) >= {"estimate/<name>", "ownship", "health"}
    for key, record in PUBLISHED.items():
        text = json.loads(json.dumps(found[key]))
        definition = text["$defs"][text["$ref"].removeprefix("#/$defs/")]
        assert list(definition["properties"]) == list(record.__struct_fields__)
        assert definition["description"]
        assert definition.get("additionalProperties", True) is (record in OPEN)


def test_a_schema_holds_everything_it_refers_to() -> None:
    for schema in schemas().values():
        text = json.dumps(schema)
        names = {part.split('"')[0] for part in text.split("#/$defs/")[1:]}
        assert names == set(schema["$defs"])


def test_the_description_lists_every_field_of_every_record_once() -> None:
    text = describe()
    for record in PUBLISHED.values():
        assert text.count(f"#### {record.__name__}\n") == 1
        section = text.split(f"#### {record.__name__}\n")[1].split("####")[0]
        for field in msgspec.structs.fields(record):
            assert section.count(f"| `{field.name}` |") == 1
    assert "| `r_OF_n` | 3 × number or null |" in text
    assert "| `mean` | array of number or null |" in text
    assert "| `target` | string, optional |" in text  # of CameraPoints
    assert "| `center` | [`Pixel`](#pixel) |" in text
    assert "[`MeasurementReport`](#measurementreport) or null" in text
    assert "`searching`, `initialising`, `tracking`, `coasting`, `lost`" in text


def test_markdown_tables_are_not_broken_by_what_stands_in_them() -> None:
    for line in describe().splitlines():
        if line.startswith("|"):
            cells = line.replace(r"\|", "").count("|") - 1
            assert cells in (2, 3)


def test_a_record_that_is_not_published_has_no_key() -> None:
    with pytest.raises(KeyError):
        key_of(SimStatus(t_ns=0, images=0, frames=0, finished=False))


def test_one_of_many_targets_has_a_key_of_its_own() -> None:
    one = make_estimate(name="traffic", target="icao/4b1a2c")
    assert key_of(one) == "estimate/traffic/icao/4b1a2c"
    assert key_of(msgspec.structs.replace(one, name="leader", target="leader")) == "estimate/leader"
    assert key_of(msgspec.structs.replace(one, name="leader", target="wingman")) == "estimate/leader/wingman"
