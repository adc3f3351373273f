"""Shipped profiles load; invalid ones are refused with key and value."""

import re
from pathlib import Path
from typing import Any, Literal

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from firmware_profiles import (
    Bath,
    Dish,
    Facts,
    Ink,
    Needle,
    Plate,
    Printer,
    ProfileError,
    Syringe,
    load,
    profile_doubts,
    shipped,
)
from firmware_profiles.errors import wording
from firmware_profiles.load import DATA
from firmware_profiles.strict_model import is_output, switch_words
from printctl.errors import RecipeError
from printctl.recipe.load import parse_recipe
from printctl.web.api import answer_errors

MODELS: tuple[type[Facts], ...] = (Printer, Needle, Syringe, Ink, Bath, Dish, Plate)
SHIPPED = [(model, name) for model in MODELS for name in shipped(model)]


@pytest.mark.parametrize(("model", "name"), SHIPPED)
def test_every_shipped_profile_loads_and_names_its_source(model: type[Facts], name: str) -> None:
    assert load(model, name).source


def test_unknown_name_lists_the_shipped_ones() -> None:
    with pytest.raises(ProfileError, match="hamilton_1ml"):
        load(Syringe, "no_such")


def _needle(tmp_path: Path, **changes: object) -> str:
    values = {"name": "n", "source": "s", "licence": "l", "inner_mm": 0.1, "outer_mm": 0.2}
    lines = [f"{key}: {value}" for key, value in ({**values, "length_mm": 10} | changes).items()]
    path = tmp_path / "needle.yaml"
    path.write_text("\n".join(lines))
    return str(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inner_m": 1}, "inner_m"),
        ({"inner_mm": -1}, r"inner_mm.*-1"),
        ({"inner_mm": 0.3}, "isn't below outer"),
        ({"tip_outer_mm": 0.2}, "give both"),
        ({"tip_outer_mm": 0.9, "cone_mm": 5}, "above outer_mm"),
        ({"inner_mm": 0.2, "tip_outer_mm": 0.2, "cone_mm": 5}, "isn't below outer"),
        ({"inner_mm": ".nan"}, "inner_mm"),
        ({"inner_mm": True}, "inner_mm must be a number"),
    ],
)
def test_wrong_value_is_refused_with_its_key(tmp_path, changes, message):
    with pytest.raises(ProfileError, match=message):
        load(Needle, _needle(tmp_path, **changes))


@pytest.mark.parametrize("name", shipped(Printer))
def test_family_or_head_that_was_never_recorded_is_labelled_in_the_profile(name: str) -> None:
    text = (DATA / "printers" / f"{name}.yaml").read_text(encoding="utf-8")
    printer = load(Printer, name)
    recorded = printer.firmware == "marlin" and printer.pneumatic is None
    assert ("not verified" in text) == (not recorded)


def test_starting_value_that_is_no_key_is_refused(tmp_path: Path) -> None:
    text = (DATA / "printers" / "generic_marlin.yaml").read_text(encoding="utf-8")
    path = tmp_path / "printer.yaml"
    path.write_text(text + "starting_values: [stepz]\n")
    with pytest.raises(ProfileError, match="stepz"):
        load(Printer, str(path))


def test_printers_of_the_issue_ship_with_their_family() -> None:
    families = {name: load(Printer, name).firmware for name in shipped(Printer)}
    assert families["ender5_duet3_replistruder5"] == "reprapfirmware"
    assert families["makergear_m2_duet2"] == "reprapfirmware"
    assert families["lulzbot_taz6_replistruder4"] == "marlin"
    assert families["klipper_bioprinter"] == "klipper"
    assert families["flashforge_finder_duet2_replistruder4"] == "reprapfirmware"
    assert families["jubilee_duet3_syringe"] == "reprapfirmware"
    assert families["prusa_i3_mk3s_syringe"] == "prusa"
    assert {"printess_marlin", "ender3_marlin_syringe", "bio_x_style_pneumatic"} <= set(families)


def _printer(tmp_path: Path, *without: str, add: str = "") -> str:
    text = (DATA / "printers" / "generic_marlin.yaml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.partition(":")[0] not in without]
    path = tmp_path / "c.yaml"
    path.write_text("\n".join(lines) + f"\n{add}\n")
    return str(path)


def _refusal(path: str) -> str:
    with pytest.raises(ProfileError) as caught:
        load(Printer, path)
    return str(caught.value)


def test_key_written_twice_is_refused_with_both_lines(tmp_path: Path) -> None:
    path = _printer(tmp_path, add="firmware: klipper")
    lines = Path(path).read_text().splitlines()
    at = [number for number, line in enumerate(lines, 1) if line.startswith("firmware:")]
    assert len(at) == 2
    said = _refusal(path)
    assert f"'firmware' stands twice, in line {at[0]} and in line {at[1]}" in said
    assert "c.yaml" in said


@pytest.mark.parametrize(
    ("without", "add", "words"),
    [
        ("firmware", "", "firmware is missing.*aerotech, klipper"),
        ("steps_per_mm", "", "steps_per_mm is missing.*x, y, z, e"),
        ("acceleration_mm_s2", "", "acceleration_mm_s2 is missing.*above 0"),
        ("firmware", "firmware: aerotech", "which controller"),
        ("firmware", "firmware: grbl", "family.*'grbl'"),
        ("x_mm", "x_mm: 5", r"x_mm .*low, high.*is 5"),
        ("x_mm", "x_mm: {low: 9, high: 2}", "x_mm: low 9 .*high 2"),
        ("x_mm", "x_mm: {low: 9}", r"x_mm\.high is missing.*number"),
        ("baud", "baud: fast", "baud .*whole number"),
        ("baud", "baud: 1", "baud .*9600.*is 1"),
        ("z_mm", "z_mm:", "z_mm .*low, high.*empty"),
        ("", "dispenser: {kind: laser}", r"dispenser\.kind .*one of"),
        ("", f"note: {'x' * 200}", "note is no key"),
    ],
)
def test_wrong_key_is_told_short_and_without_the_checker_s_own_words(tmp_path, without, add, words):
    found = _refusal(_printer(tmp_path, without, add=add))
    assert re.match(rf"c\.yaml: .*{words}", found)
    assert not re.search(r"Value error|Input should|\n", found)
    assert len(found) < 200


# --- profile of an Aerotech controller: required and forbidden keys
TEXT = (DATA / "printers" / "aerotech_pneumatic.yaml").read_text(encoding="utf-8")
HEAD = TEXT[TEXT.index("dispenser:\n") : TEXT.index("starting_values:")]
PLUNGER = TEXT.replace(HEAD, "plunger_travel_mm: 60\n")


def loaded(folder: Path, text: str) -> Printer:
    path = folder / "printer.yaml"
    path.write_text(text, encoding="utf-8")
    return load(Printer, str(path))


def test_shipped_one_isnt_streamed_and_all_else_is() -> None:
    assert not load(Printer, "aerotech_pneumatic").streamed
    assert load(Printer, "generic_marlin").streamed


def test_a_plunger_has_a_letter_of_its_own(tmp_path: Path) -> None:
    text = PLUNGER.replace("{controller: a3200}", "{controller: automation1, plunger_axis: A}")
    chosen = loaded(tmp_path, text).file_controller
    assert chosen is not None
    assert chosen.plunger_axis == "A"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("file_controller: {controller: a3200}\n", "", "which controller|starting_values"),
        ("firmware: aerotech", "firmware: marlin", "marlin isn't one"),
        ("{controller: a3200}", "{controller: a3200, plunger_axis: A}", "leave it out for a pneu"),
        ("{controller: a3200}", "{controller: automation1}", "by DigitalOutputSet"),
        ("{controller: a3200}", "{controller: a3100}", "file_controller.controller"),
        ("$DO[0].X=0", "M106 P0 S0", "one command with two"),
        ("$DO[0].X=0", "$DO[1].X=0", "one command with two"),
        ("$DO[0].X=0", "$DO[0].X=1", "one command with two"),
    ],
)
def test_what_doesnt_fit_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TEXT
    with pytest.raises(ProfileError, match=message):
        loaded(tmp_path, TEXT.replace(old, new))


def test_an_output_is_no_marlins() -> None:
    printer = load(Printer, "pneumatic_marlin")
    head = {**printer.dispenser.model_dump(), "opens": "$DO[0].X=1", "closes": "$DO[0].X=0"}
    with pytest.raises(ValueError, match="marlin doesn't know it"):
        Printer.model_validate({**printer.model_dump(), "dispenser": head})


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("$DO[3].X=1", "$DO[3].X"),
        ("$DO0.0 = 1", "$DO0.0"),
        ("DigitalOutputSet(X, 0, 1)", "DigitalOutputSet(X,0"),
    ],
)
def test_an_outputs_words_are_which_it_is_and_its_value(command: str, name: str) -> None:
    assert is_output(command)
    assert switch_words(command) == [name, "1"]


def test_commands_that_nobody_would_send_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="nothing is sent to a controller"):
        loaded(tmp_path, TEXT + "safe_state_off: ['$DO[1].X=0']\n")


@pytest.mark.parametrize("letter", ["X", "F", "G", "AB", "a"])
def test_letters_that_mean_something_else_are_refused(tmp_path: Path, letter: str) -> None:
    text = PLUNGER.replace("a3200}", f"a3200, plunger_axis: {letter}}}")
    with pytest.raises(ProfileError, match="plunger_axis"):
        loaded(tmp_path, text)


def test_a_plunger_without_a_letter_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="plunger_axis is the letter"):
        loaded(tmp_path, PLUNGER.replace("dispenser, file_controller", "file_controller"))


# --- profiles with valid keys that contradict each other
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


def test_a_syringe_that_keeps_all_its_ink_is_no_profile() -> None:
    with pytest.raises(ValueError, match="dead_volume_ul 1000 isn't below volume_ul 1000"):
        changed(Syringe, "hamilton_1ml", dead_volume_ul=1000)


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


# --- wording of schema validation errors
class Part(BaseModel):
    """Everything that a request may have."""

    model_config = ConfigDict(extra="forbid")

    count: int = Field(default=1, ge=1, le=10)
    gap_mm: FiniteFloat = Field(default=1.0, gt=0, lt=5)
    name: str = Field(default="one", min_length=2, max_length=4, pattern="^[a-z]+$")
    kind: Literal["a", "b"] = "a"
    on: bool = True
    several: list[int] = Field(default=[1], min_length=1, max_length=2)


class Whole(BaseModel):
    """A part inside."""

    part: Part = Part()


WRONG = [
    ({"count": "x"}, "must be a whole number"),
    ({"count": 1.5}, "must be a whole number"),
    ({"count": 0}, "must be at least 1"),
    ({"count": 11}, "must be at most 10"),
    ({"gap_mm": "wide"}, "must be a number"),
    ({"gap_mm": 0}, "must be above 0"),
    ({"gap_mm": 5}, "must be below 5"),
    ({"gap_mm": float("nan")}, "must be a finite number"),
    ({"name": 1}, "must be text"),
    ({"name": "a"}, "must have at least 2 characters"),
    ({"name": "abcde"}, "must have at most 4 characters"),
    ({"name": "AB"}, "must be written as ^[a-z]+$"),
    ({"kind": "c"}, "must be one of 'a' or 'b'"),
    ({"on": "perhaps"}, "must be true or false"),
    ({"several": 1}, "must be a list"),
    ({"several": []}, "must have at least 1 entries"),
    ({"several": [1, 2, 3]}, "must have at most 2 entries"),
    ({"colour": 1}, "is no key here"),
]


@pytest.mark.parametrize(("data", "words"), WRONG)
def test_each_wrong_value_is_told_in_our_words(data, words):
    with pytest.raises(ValidationError) as caught:
        Part.model_validate(data)
    assert [wording(dict(one)) for one in caught.value.errors()] == [words]


def test_what_must_be_keys_is_told_so():
    with pytest.raises(ValidationError) as caught:
        Whole.model_validate({"part": 3})
    assert wording(dict(caught.value.errors()[0])) == "must be keys with values"


def answer(**data) -> tuple[int, str]:
    app = FastAPI()
    answer_errors(app)

    @app.post("/part")
    def take(part: Part) -> int:
        return part.count

    said = TestClient(app).post("/part", json=data)
    return said.status_code, said.json()["message"]


def test_a_request_is_answered_by_place_what_it_must_be_and_what_it_is():
    assert answer(count="x") == (422, "body.count must be a whole number (is 'x')")
    assert answer(count=0) == (422, "body.count must be at least 1 (is 0)")


def test_a_recipe_is_refused_in_our_words():
    with pytest.raises(RecipeError) as caught:
        parse_recipe({"name": 3}, "a.yaml")
    assert "Input should" not in str(caught.value)
    assert "name: must be text (is 3)" in str(caught.value)
