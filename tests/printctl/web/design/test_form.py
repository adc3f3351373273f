"""Recipe form built from the schema, checked on the shipped recipes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from firmware_profiles import Ink, load
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.load import STARTER
from printctl.web.design import form as forms
from printctl.web.design.checking import check_data, check_text
from printctl.web.design.recipes import EXAMPLES
from printctl.web.design.schema import recipe_form
from printctl.web.design.widgets.field_text import input_text, parse_typed
from printctl.web.design.yaml_text import read_text, rewrite_yaml
from printctl.web.errors import BadRequestError
from printctl.web.profile_store import ProfileStore

SHIPPED = [STARTER, *sorted(EXAMPLES.glob("*.yaml"))]
FORM = recipe_form()
PLANAR: dict[str, Any] = {
    "schema": 1,
    "name": "planar",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
}


def _through_the_form(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a form that was filled in with it, each value as its input shows and reads it."""
    new: dict[str, Any] = {}
    for path, value in forms.form_values(FORM, data):
        field = forms.field_at(FORM, data, path)
        assert field is not None, path
        node = field.node.items[0] if isinstance(path[-1], int) else field.node
        if node.sort in ("number", "text", "file"):
            value = parse_typed(node, input_text(node, value))
        new = forms.set_value(FORM, new, path, value)
    return new


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_recipe_goes_through_the_form_unchanged(path: Path) -> None:
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    again = _through_the_form(data)
    assert again == data
    assert parse_recipe(again, "form") == parse_recipe(data, "file")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_recipe_has_nothing_to_mend(path: Path) -> None:
    assert (
        check_text(
            path.read_text(encoding="utf-8"), path.parent, ProfileStore(path.parent)
        ).problems
        == ()
    )


def test_every_key_of_the_model_is_in_the_form() -> None:
    keys = {field.key for field in FORM.fields}
    assert keys == {info.alias or name for name, info in Recipe.model_fields.items()}
    free = {path for path, field in FORM.walk() if field.node.sort == "free"}
    limits = {path for path in free if path[0] == "registration"}  # a number, or text: +10/-5
    assert limits == {
        ("registration", "datums"),  # a text, or a list of names
        ("registration", "diameter_tolerance_percent"),
        *(("registration", "tolerances", f"{what}_{unit}") for what in ("diameter", "mean")
          for unit in ("um", "percent")),
        ("registration", "tolerances", "vessels"),
    }  # fmt: skip
    plate = {("plate", name) for name in ("wells", "sweep", "scanned")}
    # each_part, or a list of places; an organ's inlets by name
    inlets = {("vasculature", "inlets"), ("vasculature", "anatomy", "inlets")}
    assert free - limits == plate | inlets


def test_fields_know_bounds_units_choices_and_defaults() -> None:
    fields = dict(FORM.walk())
    layer = fields["toolpath", "layer_um"]
    assert (layer.node.low, layer.node.high, layer.unit, layer.default) == (10, 2000, "µm", 60.0)
    assert fields["printer", "ink"].node.profile == "inks"
    assert fields["flow", "pulse", "shape"].node.values == ("ejection", "kassab", "roller_pump")
    tags = [option.tag for option in fields["vasculature",].node.options]
    grown = ["grow: tree", "grow: closed_loop", "grow: forest"]
    assert tags == ["design", "network", "lattice", *grown]


def test_each_option_of_a_choice_is_told_by_what_it_begins_with() -> None:
    choices = [field.node for _, field in FORM.walk() if field.node.sort == "choice"]
    assert len(choices) > 5
    for node in choices:
        for option in node.options:
            found = node.option(option.begin)
            assert found is not None
            assert found.tag == option.tag


def test_a_value_inside_a_section_that_isnt_there_brings_its_kind() -> None:
    data = forms.set_value(FORM, PLANAR, ("toolpath", "layer_um"), 50)
    assert data["toolpath"] == {"method": "fresh", "layer_um": 50}
    assert "toolpath" not in PLANAR


def test_what_is_taken_back_leaves_no_empty_section() -> None:
    data = forms.set_value(FORM, PLANAR, ("printer", "care", "reload"), True)
    assert forms.remove_value(FORM, data, ("printer", "care", "reload")) == PLANAR


def test_an_optional_section_stays_when_it_is_empty() -> None:
    data = forms.set_value(FORM, {**PLANAR, "oxygen": {}}, ("oxygen", "sherwood"), 4)
    assert forms.remove_value(FORM, data, ("oxygen", "sherwood"))["oxygen"] == {}


@pytest.mark.parametrize(
    ("more", "place", "words"),
    [
        ({"flow": {"viscosity": {"model": "carreau", "index": 7}}}, "flow.viscosity.index", "1"),
        ({"toolpath": {"method": "fresh", "layer_um": 1}}, "toolpath.layer_um", "10"),
        ({"printer": {"ink": "nope"}}, "printer.ink", "shipped: "),
        ({"seed": "x"}, "seed", "whole number"),
        ({"tissue": {"shape": "blok"}}, "tissue", "choose one of"),
        ({"colour": "red"}, "colour", "spelling"),
        (
            {"tissue": {**PLANAR["tissue"], "keep_out": [{"shape": "sphere", "radius_mm": 1}]}},
            "tissue.keep_out.0.centre_mm",
            "missing",
        ),
        (
            {"toolpath": {"method": "fresh", "regions": [{"where": {"mesh": "/etc/passwd"}}]}},
            "toolpath.regions.0.where.mesh",
            "beside the recipe",
        ),
    ],
)
def test_a_problem_stands_at_its_field(
    more: dict[str, Any], place: str, words: str, tmp_path: Path
) -> None:
    problems = check_data({**PLANAR, **more}, tmp_path, ProfileStore(tmp_path)).problems
    found = [problem for problem in problems if problem.place == place]
    assert found, [problem.message for problem in problems]
    assert words in found[0].message


def test_own_profiles_are_those_in_the_store(tmp_path: Path) -> None:
    store = ProfileStore(tmp_path)
    own = store.folder(Ink) / "measured.yaml"
    own.parent.mkdir(parents=True)
    own.write_text(yaml.safe_dump(load(Ink, "collagen_fresh").model_dump(mode="json")))
    (own.parent / "no name.yaml").write_text("{}")
    elsewhere = tmp_path / "elsewhere.yaml"
    elsewhere.write_text(own.read_text())

    def problems(name: str) -> list[str]:
        data = {**PLANAR, "printer": {"ink": name}}
        return [one.message for one in check_data(data, tmp_path, store).problems]

    assert problems(store.given(Ink, "measured")) == []
    assert "of your own in" in problems(str(elsewhere))[0]
    assert "of your own in" in problems("../profiles/inks/measured.yaml")[0]
    own.write_text("viscosity: x")
    assert problems(store.given(Ink, "measured")) != []
    assert store.names(Ink)[0] == "measured"


def test_a_changed_value_leaves_the_comments(tmp_path: Path) -> None:
    text = STARTER.read_text(encoding="utf-8")
    data = read_text(text)
    changed = forms.set_value(FORM, data, ("toolpath", "layer_um"), 75)
    changed = forms.set_value(FORM, changed, ("oxygen",), {})
    changed = forms.remove_value(FORM, changed, ("scan", "shrink_percent"))
    again = rewrite_yaml(text, changed)
    assert read_text(again) == changed
    assert again.count("#") == text.count("#")
    assert "layer_um: 75" in again


def test_a_section_in_one_line_stays_in_one() -> None:
    text = "# mine\nname: n  # its name\ntoolpath: {method: fresh, layer_um: 60}  # thin\n"
    data = forms.set_value(FORM, read_text(text), ("toolpath", "layer_um"), 1)
    wanted = "# mine\nname: n  # its name\ntoolpath: {method: fresh, layer_um: 1}  # thin\n"
    assert rewrite_yaml(text, data) == wanted


BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nname: n\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "aliases"),
        ("schema: 1\nname: !!python/object/apply:os.system ['true']\n", "tags"),
        ("schema: 1\nname: !something x\n", "tags"),
        ("[" * 40 + "]" * 40, "levels"),
        ("- 1\n- 2\n", "no keys"),
        ("a: [1, 2\n", "isn't YAML"),
        ("a: " + "x" * 300_000, "at most"),
        ("a: \x00", "isn't YAML"),
        ("1: 2\n", "no keys"),
        ("name: \ud800", "UTF-8"),
    ],
)
def test_hostile_text_is_refused(text: str, words: str) -> None:
    with pytest.raises(BadRequestError, match=words):
        read_text(text)


@pytest.mark.parametrize(
    "text",
    [
        "flow: {-1: 2, null: 3, 1.5: 4, true: 5}",
        "tissue: [1, {2: 3}]",
        "tissue: {keep_out: {a: [1]}, shape: block}",
        "tissue: {mesh: '" + "x" * 5000 + "', unit: mm}",
        'tissue: {mesh: "a\\0b", unit: mm}',
        "seed: " + "9" * 5000,
        "seed: .nan",
        "name: 2020-01-01",
        "plate: {profile: [], sweep: 7, wells: {}}",
        "toolpath: {method: [1]}",
        "vasculature: {grow: {a: b}}",
        "printer: {heads: [1, null, {ink: 5}], ink: [x]}",
    ],
)
def test_nonsense_is_told_and_never_a_fault(text: str, tmp_path: Path) -> None:
    assert check_text(text, tmp_path, ProfileStore(tmp_path)).problems
