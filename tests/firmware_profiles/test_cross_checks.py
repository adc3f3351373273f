"""Profiles with valid keys that contradict each other."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_profiles import (
    Bath,
    Dish,
    Facts,
    Ink,
    Needle,
    Plate,
    Printer,
    Syringe,
    load,
    profile_doubts,
    shipped,
)

MODELS: tuple[type[Facts], ...] = (Printer, Needle, Syringe, Ink, Bath, Dish, Plate)
SYRINGES = [load(Syringe, name) for name in shipped(Syringe)]


@pytest.mark.parametrize(
    ("model", "name"), [(model, name) for model in MODELS for name in shipped(model)]
)
def test_no_shipped_profile_is_gravely_wrong(model: type[Facts], name: str) -> None:
    assert [doubt for doubt in profile_doubts(load(model, name), SYRINGES) if doubt.grave] == []


FAST = {"max_speed_mm_s": {"x": 300, "y": 300, "z": 5, "e": 20}}
FEW_STEPS = {"max_step_rate_hz": 25e3, "max_speed_mm_s": {"x": 300, "y": 300, "z": 5, "e": 4}}


def changed(model: type[Facts], name: str, **changes: Any) -> Facts:
    return model.model_validate(load(model, name).model_dump(exclude_unset=True) | changes)


@pytest.mark.parametrize(
    ("model", "name", "changes", "key", "says"),
    [
        (Printer, "generic_marlin", FAST, "max_speed_mm_s.e", "128000 steps/s, above 40000"),
        (Printer, "generic_marlin", FEW_STEPS, "max_speed_mm_s.e", "25600 steps/s, above 25000"),
        (Printer, "generic_marlin", {"max_line_bytes": 200}, "max_line_bytes", "of 128"),
        (Printer, "generic_marlin", {"safe_state_on": ["camera"]}, "safe_state_on", "neither ink"),
        (Syringe, "hamilton_1ml", {"inner_mm": 0.461}, "inner_mm", "see the units"),
        (Syringe, "hamilton_1ml", {"dead_volume_ul": 900}, "dead_volume_ul", "more than half"),
        (Needle, "30g", {"inner_mm": 0.30}, "outer_mm", "5 µm"),
        (Needle, "22g", {"length_mm": 0.5}, "length_mm", "short for a bore"),
        (Ink, "collagen_fresh", {"calibrated": True}, "calibrated", "take out what was measured"),
        (Bath, "gelatin_support", {"max_printing_c": 37}, "max_printing_c", "37 °C isn't below"),
    ],
)
def test_a_contradiction_is_named_with_key_and_values(model, name, changes, key, says):
    grave = [
        doubt for doubt in profile_doubts(changed(model, name, **changes), SYRINGES) if doubt.grave
    ]
    assert [doubt.key for doubt in grave] == [key]
    assert says in grave[0].text


def test_a_printer_that_states_no_safe_state_is_not_to_be_used() -> None:
    values = load(Printer, "generic_marlin").model_dump(exclude_unset=True)
    del values["safe_state_on"]
    grave = [doubt.key for doubt in profile_doubts(Printer.model_validate(values)) if doubt.grave]
    assert grave == ["safe_state_on"]


def test_what_isn_t_grave_is_told_all_the_same() -> None:
    told = {doubt.key for doubt in profile_doubts(load(Printer, "makergear_m2_duet2"), SYRINGES)}
    assert {"firmware", "starting_values", "steps_per_mm.e"} <= told


def test_a_starting_value_that_is_no_key_is_refused_for_every_sort() -> None:
    with pytest.raises(ValueError, match="yield_stress"):
        changed(Bath, "gelatin_support", starting_values=["yield_stress"])
    with pytest.raises(ValueError, match=r"steps_per_mm\.u"):
        changed(Printer, "generic_marlin", starting_values=["steps_per_mm.u"])
