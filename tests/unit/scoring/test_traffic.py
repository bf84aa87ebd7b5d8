"""Scores of traffic, against predictions made by hand."""

from onboard.scoring.traffic import Encounter


def test_an_approach_is_predicted_well_within_15_m_or_a_tenth() -> None:
    assert Encounter(0.0, 20.0, 34.0).predicted_well
    assert not Encounter(0.0, 20.0, 36.0).predicted_well
    assert Encounter(0.0, 500.0, 545.0).predicted_well
    assert not Encounter(0.0, 500.0, 555.0).predicted_well
