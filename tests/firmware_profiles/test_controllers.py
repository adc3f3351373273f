"""Profile of an Aerotech controller: required and forbidden keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_profiles import Printer, ProfileError, load
from firmware_profiles.load import DATA
from firmware_profiles.strict_model import is_output, switch_words

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
        Printer.model_validate({**printer.model_dump(), "dispenser": head, "safe_state_off": ()})


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
