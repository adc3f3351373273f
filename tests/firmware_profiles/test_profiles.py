"""Shipped profiles load; invalid ones are refused with key and value."""

import re
from pathlib import Path

import pytest

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
    shipped,
)
from firmware_profiles.load import DATA

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
