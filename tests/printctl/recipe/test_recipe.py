"""Recipe validation errors: key path, value, limit and remedy."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError
from typer.testing import CliRunner

from printctl.cli.main import app
from printctl.errors import RecipeError, UsageError
from printctl.pipeline.facts import recipe_facts
from printctl.pipeline.network_sources.options import growth_options
from printctl.recipe import Recipe, load, load_recipe, parse_recipe
from printctl.recipe.load import Change, Step, migrated_text
from printctl.recipe.section_files import tolerances_of
from printctl.recipe.sections.growth import GrownNetwork, LatticeNetwork
from printctl.recipe.sections.measuring import RegistrationPart
from printctl.recipe.sections.tissue import CylinderPart, DepthDemandPart, MeshPart

ROOT = Path(__file__).parents[3]
GOOD = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())


def _changed(path: str, value: Any) -> dict[str, Any]:
    data = deepcopy(GOOD)
    *folders, key = path.split(".")
    inner = data
    for folder in folders:
        inner = inner[folder]
    inner[key] = value
    return data


def test_polish_is_read_where_it_was_off_and_refused_where_it_was_on() -> None:
    growth: dict[str, Any] = {"grow": "tree", "terminals": 10}
    assert GrownNetwork.model_validate(growth | {"polish": False}) == GrownNetwork(**growth)
    with pytest.raises(ValidationError, match="polish"):
        GrownNetwork.model_validate(growth | {"polish": True})


@pytest.mark.parametrize(
    "path",
    sorted(
        [
            *ROOT.glob("examples/*.yaml"),
            *ROOT.glob("examples/paper/*.yaml"),
            ROOT / "printctl" / "recipe" / "starter.yaml",
        ]
    ),
)
def test_every_shipped_recipe_is_valid(path: Path) -> None:
    assert load_recipe(path).schema_version == 1


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("tissue.siz_mm", [1, 1, 1], r"tissue\.siz_mm.*remove it"),
        ("toolpath.layer_um", 0.06, r"toolpath\.layer_um.*10.*0\.06"),
        ("toolpath.write_speed_mm_s", float("inf"), r"toolpath\.write_speed_mm_s"),
        ("flow.inlet_flow_ml_min", -1, r"flow\.inlet_flow_ml_min.*0.*-1"),
        ("tissue", {"shape": "blok"}, r"tissue: 'blok'.*block"),
        ("tissue", {"mesh": "a.stl"}, r"tissue\.unit.*add it"),
        ("tissue", {"mesh": "a.stl", "unit": "inches"}, r"tissue\.unit.*'in'.*inches"),
        ("vasculature", {}, r"vasculature.*design.*network.*grow"),
        ("schema", 2, r"schema 2.*up to 1.*update"),
        ("name", "../up", r"name.*\.\./up"),
        ("seed", -1, r"seed.*-1"),
        ("seed", True, r"seed: must be a whole number \(is True\)"),
        ("tissue.size_mm", ["16", 8, 3], r"tissue\.size_mm\.0: must be a number \(is '16'\)"),
        ("print_scale", False, r"print_scale: must be a number"),
        ("printer.place_mm", [1e9, 0, 0], r"place_mm\.0: must be at most 10000"),
        ("tissue", "block", r"tissue: must be keys with values \(is 'block'\), of a kind of"),
        ("tissue", {"size_mm": [1, 1, 1]}, r"tissue: doesn't say its kind; give one of 'mesh'"),
        ("scan.voxel_um", [25, 25, 0.1], r"scan.*0\.1.*1 to 1000"),
        ("toolpath.thinnest_layer_um", 60, r"thinnest_layer_um is 60.*layer_um 60.*lower it"),
        ("toolpath.stair_um", 10, r"stair_um is 10.*give thinnest_layer_um"),
        ("tissue", {"shape": "cylinder", "diameter_mm": 6, "height_mm": 3}, "made for a block"),
        (
            "tissue.size_mm",
            [1, 8, 3],
            r"a block of 16 x 8 x 3 mm, not 1 x 8 x 3: its ports and fid",
        ),
    ],
)
def test_wrong_recipe_names_place_value_and_remedy(path: str, value: Any, message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        parse_recipe(_changed(path, value), "test.yaml")


def test_all_problems_are_told_at_once() -> None:
    data = _changed("toolpath.layer_um", 1)
    data["seed"] = "x"
    with pytest.raises(RecipeError) as caught:
        parse_recipe(data, "test.yaml")
    assert "layer_um" in str(caught.value)
    assert "seed" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"), [("", "holds no keys"), ("a: [", "isn't YAML"), ("- 1", "holds no keys")]
)
def test_file_that_is_no_recipe_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    with pytest.raises(RecipeError, match=message):
        load_recipe(path)


def test_a_solid_gyroid_is_refused_before_anything_is_made() -> None:
    recipe = deepcopy(GOOD)
    recipe["toolpath"]["infill"] = "gyroid"
    with pytest.raises(RecipeError, match=r"meet above 70 %; lower infill_percent \(it is 100\)"):
        parse_recipe(recipe, "test.yaml")
    recipe["toolpath"]["infill_percent"] = 40
    assert parse_recipe(recipe, "test.yaml").toolpath.model_dump()["infill"] == "gyroid"


@pytest.mark.parametrize(
    ("region", "says"),
    [
        ({}, r"toolpath\.regions\.0.*either where or around_vessels_mm"),
        (
            {"around_vessels_mm": 1, "where": {"mesh": "a.stl", "unit": "mm"}},
            r"either where or around_vessels_mm",
        ),
        ({"around_vessels_mm": 1, "infill": "gyroid"}, r"meet above 70 %"),
        ({"around_vessels_mm": -1}, r"around_vessels_mm"),
    ],
)
def test_a_region_says_where_and_how(region: dict[str, Any], says: str) -> None:
    recipe = deepcopy(GOOD)
    recipe["toolpath"]["regions"] = [region]
    with pytest.raises(RecipeError, match=says):
        parse_recipe(recipe, "test.yaml")


def test_key_written_twice_is_refused_with_both_lines(tmp_path: Path) -> None:
    path = tmp_path / "twice.yaml"
    path.write_text("schema: 1\nname: one\nseed: 3\nname: two\n")
    with pytest.raises(RecipeError, match=r"twice\.yaml.*'name' .* in line 2 and in line 4"):
        load_recipe(path)


# --- recipe round trip: written with all defaults and read back equal
EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.yaml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_dumped_recipe_reads_back_as_the_same(path: Path) -> None:
    recipe = load_recipe(path)
    assert parse_recipe(recipe.model_dump(mode="json", by_alias=True), "dumped") == recipe


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_recipe_of_a_manifest_reads_back_as_the_same(path: Path) -> None:
    recipe = load_recipe(path)
    assert parse_recipe(recipe_facts(recipe), "manifest.json") == recipe


# --- recipe section on datums
def test_a_recipe_names_its_datums_and_slips_are_refused() -> None:
    part = RegistrationPart.model_validate({"datums": ["face -z", "axis 3"]})
    assert part.datums == ["face -z", "axis 3"]
    assert RegistrationPart().datums == []
    with pytest.raises(ValidationError, match="'face up' isn't known; give a face"):
        RegistrationPart.model_validate({"datums": ["face up"]})


# --- tolerances in a recipe, a file and on the command line
WHOLE = """
diameter_percent: +8/-4
mean_um: 12
narrowest_um: 20
leak_um: 50
vessels:
  - {vessels: [3], diameter_um: 30, open: false}
  - {kinds: [artery], offset_um: 40}
"""


def file(folder: Path, text: str) -> Path:
    path = folder / "tolerance.yaml"
    path.write_text(text)
    return path


def test_the_old_names_still_set_the_limits() -> None:
    part = RegistrationPart(tolerance_um=80, diameter_tolerance_percent=12)
    found = part.all_tolerances()
    assert found.rms_um == 80
    assert (found.limits.diameter.minus_percent, found.limits.diameter.plus_percent) == (12, 12)


def test_a_file_sets_sides_features_and_vessels(tmp_path: Path) -> None:
    found = tolerances_of(file(tmp_path, WHOLE), 50.0, None)
    limits = found.of(0, "channel")
    assert found.rms_um == 50
    assert (limits.diameter.minus_percent, limits.diameter.plus_percent) == (4, 8)
    assert limits.mean is not None
    assert limits.mean.plus_um == 12
    assert limits.leak_um == 50
    assert found.of(3, "channel").diameter.minus_um == 30
    assert not found.of(3, "channel").open
    assert found.of(1, "artery").offset_um == 40


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("diameter_prcent: 3", "diameter_prcent: .*remove it or mend its spelling"),
        ("offset_um: -3", r"offset_um: must be above 0 .is -3"),
        ("diameter_percent: ten", "like 10, or both sides, like .10/-5 .is 'ten'"),
        ("diameter_percent: +0/-0", "one above 0"),
        ("vessels: [{open: true}]", "vessels.0: names no vessel; give either vessels"),
        ("vessels: [{vessels: [0], kinds: [vein]}]", "names both vessels and kinds; give either"),
        ("diameter_percent:", "diameter_percent has no value; give one, or leave"),
        ("diameter_percent: true", "like 10, or both sides, like .10/-5 .is True"),
        ("vessels: [{vessels: [true], open: true}]", "must be a whole number .is True"),
        ("offset_um: '40'", "offset_um: must be a number .is '40'"),
        ("leak_um: yes", "leak_um: must be a number .is True"),
        ("open: 1", "open: must be true or false .is 1"),
        ("offset_um: " + 70_000 * "a", r"must be a number .is 'a{59} \.\.\. .70002 characters"),
    ],
)
def test_a_wrong_limit_is_named_with_its_remedy(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        tolerances_of(file(tmp_path, text), None, None)


# --- migration of recipes from older schemas; refusal of newer ones
TWICE = Step(
    0,
    "a cylinder is said by its diameter",
    (Change(("tissue", "radius_mm"), "diameter_mm", lambda radius: 2 * radius),),
)
OLD = """\
# A cylinder with a tree.
schema: 0   # the first
name: old

tissue:
  shape: cylinder
  radius_mm: 3.5  # measured by hand
  height_mm: 4
vasculature: {grow: tree, terminals: 20}
"""


@pytest.fixture
def old(monkeypatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(load, "STEPS", (TWICE,))
    path = tmp_path / "old.yaml"
    path.write_text(OLD)
    return path


def test_comments_and_order_stay_when_a_text_is_migrated():
    expected = (
        OLD.replace("schema: 0", "schema: 1").replace("radius_mm: 3.5", "diameter_mm: 7.0").strip()
    )
    assert migrated_text(OLD, (TWICE,)).strip() == expected


def test_old_recipe_is_read_with_a_note(old: Path):
    notes: list[str] = []
    recipe = load_recipe(old, notes.append)
    assert recipe.tissue.diameter_mm == 7
    assert len(notes) == 1
    assert "of schema 0, read as 1" in notes[0]
    assert f"printctl recipe migrate {old}" in notes[0]


def test_newer_recipe_is_refused_and_says_what_to_do():
    with pytest.raises(RecipeError, match=r"new\.yaml is of schema 7.*up to 1.*update"):
        parse_recipe({"schema": 7, "unheard_of": True}, "new.yaml")


def test_migrate_writes_in_place_and_keeps_the_old_file(old: Path):
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old)])
    assert done.exit_code == 0, done.output
    assert "a cylinder is said by its diameter" in done.output
    assert load_recipe(old).tissue.diameter_mm == 7
    assert old.read_text().startswith("# A cylinder with a tree.\nschema: 1   # the first")
    assert old.with_name("old.schema0.yaml").read_text() == OLD


def test_migrate_beside_leaves_the_old_file_as_it_was(old: Path):
    new = old.with_name("new.yaml")
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old), "--out", str(new)])
    assert done.exit_code == 0, done.output
    assert old.read_text() == OLD
    assert yaml.safe_load(new.read_text())["schema"] == 1
    assert sorted(path.name for path in old.parent.iterdir()) == ["new.yaml", "old.yaml"]


def test_migrate_never_writes_over_a_file(old: Path):
    kept = old.with_name("old.schema0.yaml")
    kept.write_text("mine")
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old)])
    assert done.exit_code != 0
    assert kept.read_text() == "mine"
    assert old.read_text() == OLD


def test_migrate_refuses_what_would_be_wrong_afterwards(old: Path):
    wrong = OLD + "colour: red\n"
    old.write_text(wrong)
    done = CliRunner().invoke(app, ["recipe", "migrate", str(old)])
    assert "colour" in str(done.exception)
    assert old.read_text() == wrong


def test_digits_with_colons_are_no_number(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="1:30 in line 1 would be read as minutes"):
        tolerances_of(file(tmp_path, "offset_um: 1:30"), None, None)


def test_numbers_with_an_exponent_alone_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    plain = yaml.safe_dump(_changed("print_scale", 0.5)).replace("0.5", "5e-1")
    path.write_text(plain)
    assert load_recipe(path).print_scale == 0.5


# --- recipe section on tree growth: invalid values refused with key and remedy
def recipe_of(**keys: Any) -> Recipe:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = {"grow": "tree", **keys}
    return parse_recipe(data, "test.yaml")


def grown(**keys: Any) -> GrownNetwork:
    part = recipe_of(**keys).vasculature
    assert isinstance(part, GrownNetwork)
    return part


def test_all_that_growth_knows_can_be_said() -> None:
    part = grown(
        terminal_flow="demand",
        viscosity_law="pries_1994",
        haematocrit=0.4,
        branch_angle_degrees=[30, 140],
        turn_angle_degrees=[0, 80],
        flow_ratio=0.05,
        length_to_radius=2,
        penalty={"depth_mm": [0, 1], "factor": [3, 1]},
        root="search",
        root_candidates=8,
        stages=[{"terminals": 50, "clearance_mm": 0.3}, {"terminals": 800}],
    )
    assert part.stages[0].clearance_mm == 0.3
    assert part.files() == []
    named = grown(terminal_points="wells.csv", trunk="artery.swc")
    assert named.files() == ["wells.csv", "artery.swc"]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"terminals": 9, "inlets": "every"}, r"inlets.*each_part"),
        ({"terminals": 9, "inlets": [{"at_mm": [1, 2]}]}, r"inlets.*at_mm"),
        (
            {"terminals": 9, "inlets": "each_part", "printable": True},
            r"inlets don't go with printable",
        ),
        (
            {"terminals": 9, "inlets": [{"at_mm": [1, 2, 3]}], "root_mm": [1, 2, 3]},
            r"remove root_mm",
        ),
        ({}, r"how many terminals isn't said; add terminals"),
        ({"terminals": 9, "terminal_points": "a.csv"}, r"terminals and terminal_points each say"),
        ({"terminals": 9, "stages": [{"terminals": 9}]}, r"terminals and stages each say"),
        ({"stages": [{"terminals": 9}, {"terminals": 5}]}, r"stages reach \[9, 5\].*ascend"),
        ({"stages": [{"terminals": 9, "seed": 1}]}, r"stages.0.seed.*remove it"),
        ({"terminals": 9, "branch_angle_degrees": [90, 30]}, r"branch_angle_degrees \[90, 30\]"),
        ({"terminals": 9, "turn_angle_degrees": [0, 200]}, r"turn_angle_degrees.*180.*200"),
        ({"terminals": 9, "flow_ratio": 0.7}, r"flow_ratio.*0\.5.*0\.7"),
        ({"terminals": 9, "terminal_flow": "fair"}, r"terminal_flow.*'equal' or 'demand'.*fair"),
        ({"terminals": 9, "viscosity_law": "carreau"}, r"viscosity_law.*pries_1994.*carreau"),
        (
            {"terminals": 9, "penalty": {"depth_mm": [0, 1], "factor": [1]}},
            r"penalty: 2 depths but 1 factors",
        ),
        (
            {"terminals": 9, "penalty": {"depth_mm": [1, 0], "factor": [1, 2]}},
            r"doesn't ascend; sort",
        ),
        ({"terminals": 9, "root": "search", "root_mm": [0, 0, 0]}, r"without root_mm"),
        ({"terminals": 9, "root": "here"}, r"root: .*'search'.*here"),
        ({"terminals": 9, "trunk": "a.csv"}, r"trunk a\.csv.*give trunk_unit"),
        ({"terminals": 9, "trunk": "a.json", "trunk_unit": "mm"}, r"remove trunk_unit"),
        ({"terminals": 9, "trunk": "a.stl"}, r"trunk a\.stl isn't a \.csv"),
        ({"terminals": 9, "polish": True}, r"vasculature\.polish.*remove it"),
        (
            {"stages": [{"terminals": 9}], "printable": True},
            r"printable doesn't go with stages yet",
        ),
    ],
)
def test_wrong_growth_names_place_value_and_remedy(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe_of(**keys)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"network": "a.csv"}, r"a\.csv: .*give unit"),
        ({"network": "a.vtp"}, r"a\.vtp: .*give unit"),
        ({"network": "a.json", "unit": "cm"}, r"a\.json: .*remove unit"),
        ({"network": "a.stl", "unit": "mm"}, r"a\.stl isn't a \.csv"),
    ],
)
def test_a_given_network_says_its_unit_where_its_file_doesnt(
    given: dict[str, str], message: str
) -> None:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = given
    with pytest.raises(RecipeError, match=message):
        parse_recipe(data, "test.yaml")
    data["vasculature"] = {"network": "a.json"}
    assert parse_recipe(data, "test.yaml").vasculature.files() == ["a.json"]


# --- recipe section on forests: what is implied, and what is refused with a remedy
ARTERY, VEIN, LYMPH = ({"kind": kind} for kind in ("artery", "vein", "lymph"))


def recipe_of_forest(
    networks: list[Any], flow: dict[str, Any] | None = None, **keys: Any
) -> Recipe:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = {"grow": "forest", "terminals": 9, "networks": networks, **keys}
    data["flow"] = flow or {}
    return parse_recipe(data, "test.yaml")


@pytest.mark.parametrize(
    ("networks", "keys", "said"),
    [
        ([{"trees": [LYMPH]}], {}, r"tree 0 of the forest is a lymph without partner.*supplies"),
        ([{"trees": [ARTERY, LYMPH]}], {}, r"trees are artery, lymph; say join"),
        ([{"trees": [ARTERY, VEIN, LYMPH], "join": "loops"}], {}, r"give lymph a network"),
        ([{"trees": [ARTERY, VEIN], "join": "mixing"}], {}, r"mixing takes three trees or more"),
        (
            [{"trees": [ARTERY, VEIN | {"terminals": 5}]}],
            {},
            r"networks\.0 joins 9 arterial terminals to 5 venous",
        ),
        (
            [{"trees": [ARTERY, ARTERY, VEIN | {"terminals": 5}], "join": "mixing"}],
            {},
            r"networks\.0 mixes trees of 9, 9, 5 terminals",
        ),
        ([{"trees": [ARTERY]}], {"root_mm": [0, 0, 0]}, r"each tree of a forest has its root_mm"),
        ([{"network": "old.csv", "unit": "mm"}], {}, r"a forest grows at least one tree"),
        ([{"trees": [ARTERY]}, {"network": "old.csv"}], {}, r"give unit"),
        ([{"trees": [ARTERY | {"trunk": "a.swc", "root_mm": [0, 0, 0]}]}], {}, r"without root_mm"),
        ([{"trees": [ARTERY]}], {"radius_exponent": 9}, r"radius_exponent"),
    ],
)
def test_what_cannot_be_is_refused(networks: list[Any], keys: dict[str, Any], said: str) -> None:
    with pytest.raises(RecipeError, match=said):
        recipe_of_forest(networks, **keys)


# --- recipe section on lattices
BLOCK = {"shape": "block", "size_mm": [16, 8, 8]}


def parsed(**lattice: Any) -> LatticeNetwork:
    part = {"lattice": "grid", "cell_mm": 3.0, "diameter_mm": 0.6, **lattice}
    data = {"schema": 1, "name": "x", "tissue": BLOCK, "vasculature": part}
    found = parse_recipe(data, "recipe.yaml").vasculature
    assert isinstance(found, LatticeNetwork)
    return found


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lattice": "cube"}, r"vasculature\.lattice.*gyroid.*'cube'"),
        ({"cell_mm": -1}, r"vasculature\.cell_mm.*-1"),
        ({"cell": 3}, r"vasculature\.cell: .*remove it"),
        ({"axis": "w"}, r"vasculature\.axis"),
    ],
)
def test_wrong_lattices_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        parsed(**change)


# --- recipe section on tissue: zones, demand, label images; errors named with their place
NEEDLE = {"shape": "cylinder", "from_mm": [0, 0, 0], "to_mm": [0, 0, 9], "radius_mm": 0.5}
BALL = {"shape": "sphere", "centre_mm": [0, 0, 0], "radius_mm": 2}
BOX = {"shape": "block", "from_mm": [0, 0, 0], "to_mm": [1, 1, 1]}
PORT = {"mesh": "port.stl", "unit": "mm"}
LABELS = {"labels": "seg.nii.gz", "value": 3}


def recipe(**tissue: Any) -> Any:
    """A recipe with this tissue."""
    data = {"schema": 1, "name": "x", "vasculature": {"grow": "tree", "terminals": 9}}
    return parse_recipe({**data, "tissue": tissue}, "test.yaml").tissue


@pytest.mark.parametrize(
    "source",
    [
        {"shape": "biventricle"},
        {"mesh": "heart.stl", "unit": "mm"},
        {"points": "heart.xyz", "unit": "cm"},
        LABELS,
    ],
)
def test_every_source_takes_zones_and_demand(source: dict[str, Any]) -> None:
    table = {"depth_mm": [0, 1], "relative": [1, 2]}
    part = recipe(**source, keep_out=[NEEDLE, BALL, PORT], keep_within=[BOX], demand=table)
    assert isinstance(part.keep_out[0], CylinderPart)
    assert isinstance(part.keep_out[2], MeshPart)
    assert isinstance(part.demand, DepthDemandPart)
    assert "port.stl" in part.files()


@pytest.mark.parametrize(
    ("tissue", "message"),
    [
        ({"keep_out": [{**NEEDLE, "radius_mm": 0}]}, r"keep_out\.0.*radius_mm.*0"),
        ({"keep_out": [{**NEEDLE, "radius": 1}]}, r"keep_out\.0.*radius.*remove it"),
        ({"keep_out": [{"shape": "cone"}]}, r"cone.*cylinder"),
        ({"keep_out": [{"mesh": "a.stl"}]}, r"keep_out\.0.*unit.*add it"),
        ({"demand": {"depth_mm": [0, 1], "relative": [1]}}, r"demand.*2 depths but 1 relative"),
        ({"demand": {"depth_mm": [1, 0], "relative": [1, 1]}}, r"demand.*doesn't ascend"),
        ({"demand": {"depth_mm": [0, 1], "relative": [0, 0]}}, r"demand.*0 throughout"),
        ({"demand": {"depth_mm": [0], "relative": [-1]}}, r"demand.*relative.*-1"),
        ({"demand": {"image": "a.nii", "voxel_mm": [1, 1, 0]}}, r"demand.*voxel_mm.*0"),
    ],
)
def test_wrong_section_names_place_and_value(tissue: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe(shape="biventricle", **tissue)


@pytest.mark.parametrize(
    ("anatomy", "tree"), [({"template": "liver"}, 2), ({"template": "kidney", "vein": "beside"}, 1)]
)
def test_flow_that_cannot_drive_a_template_s_veins_is_refused(
    anatomy: dict[str, Any], tree: int
) -> None:
    data = GOOD | {
        "tissue": {"shape": anatomy["template"]},
        "vasculature": {"grow": "tree", "terminals": 60, "anatomy": anatomy},
        "toolpath": {"method": "embedded", "needle": "30g_50mm"},
    }
    by_pressure = {"inlet_pressure_mmhg": 9}
    with pytest.raises(RecipeError, match=rf"\(tree {tree}\).*inlet_pressure.*trees: \[{tree}\]"):
        parse_recipe(data | {"flow": by_pressure}, "r.yaml")
    with pytest.raises(RecipeError, match=r"one_d, three_d and exports know one supply"):
        parse_recipe(data | {"flow": {"three_d": {}}}, "r.yaml")
    own = {"supplies": [{"trees": [tree], "flow_ml_min": 1}]}
    assert parse_recipe(data | {"flow": by_pressure | own}, "r.yaml").flow.supplies


@pytest.mark.parametrize(
    ("key", "value", "least"),
    [
        ("viscosity_mpa_s", 1e-6, "0.01"),
        ("smallest_diameter_mm", 1e-300, "0.0002"),
        ("perfusion_ml_min_per_ml", 1e-300, "1e-06"),
    ],
)
def test_growth_s_own_limits_are_the_recipe_s(key: str, value: float, least: str) -> None:
    tree = {"grow": "tree", "terminals": 9}
    with pytest.raises(RecipeError, match=rf"vasculature\.{key}.*at least {least}.*{value:g}"):
        parse_recipe(GOOD | {"vasculature": tree | {key: value}}, "r.yaml")
    part = GrownNetwork(**tree, **{key: float(least)})  # type: ignore[arg-type]
    assert growth_options(part, 1, Path()).terminals == 9
