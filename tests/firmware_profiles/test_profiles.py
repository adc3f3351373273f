"""Shipped profiles load; wrong ones are refused with key and value."""

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


def test_every_sort_ships_at_least_one() -> None:
    assert {model for model, _ in SHIPPED} == set(MODELS)


def test_unknown_name_lists_the_shipped_ones() -> None:
    with pytest.raises(ProfileError, match="hamilton_1ml"):
        load(Syringe, "no_such")


def _needle(tmp_path: Path, **changes: object) -> str:
    values = {"name": "n", "source": "s", "licence": "l", "inner_mm": 0.1, "outer_mm": 0.2}
    lines = [f"{key}: {value}" for key, value in ({**values, "length_mm": 10} | changes).items()]
    path = tmp_path / "needle.yaml"
    path.write_text("\n".join(lines))
    return str(path)


def test_own_file_is_loaded_by_path(tmp_path: Path) -> None:
    assert load(Needle, _needle(tmp_path)).inner_mm == 0.1


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
    ],
)
def test_wrong_value_is_refused_with_its_key(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ProfileError, match=message):
        load(Needle, _needle(tmp_path, **changes))


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="doesn't exist"):
        load(Needle, str(tmp_path / "none.yaml"))


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
