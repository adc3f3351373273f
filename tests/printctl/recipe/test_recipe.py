"""Recipe validation errors: key path, value, limit and remedy."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from printctl.errors import RecipeError
from printctl.recipe import load_recipe, parse_recipe
from printctl.recipe.making import PrinterPart

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
        ("printer.port", "/dev/ttyACM0", r"simulated scan.*ttyACM0.*scan\.file"),
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
    ("text", "message"),
    [("", "holds no keys"), ("a: [", "isn't YAML"), ("- 1", "holds no keys")],
)
def test_file_that_is_no_recipe_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    with pytest.raises(RecipeError, match=message):
        load_recipe(path)


def test_missing_file_points_to_init(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="printctl init"):
        load_recipe(tmp_path / "none.yaml")


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


def test_files_of_regions_are_the_recipe_s_files() -> None:
    recipe = deepcopy(GOOD)
    recipe["toolpath"]["regions"] = [
        {"where": {"mesh": "a.stl", "unit": "mm"}},
        {"around_vessels_mm": 1},
    ]
    assert parse_recipe(recipe, "test.yaml").toolpath.files() == ["a.stl"]


def test_key_written_twice_is_refused_with_both_lines(tmp_path: Path) -> None:
    path = tmp_path / "twice.yaml"
    path.write_text("schema: 1\nname: one\nseed: 3\nname: two\n")
    with pytest.raises(RecipeError, match=r"twice\.yaml.*'name' .* in line 2 and in line 4"):
        load_recipe(path)


def test_faults_are_a_simulated_printer_s() -> None:
    given = {"port": "simulated", "faults": "faults.yaml"}
    assert PrinterPart.model_validate(given).files() == ["faults.yaml"]
    with pytest.raises(ValidationError, match="leave faults out"):
        PrinterPart.model_validate(given | {"port": "/dev/ttyACM0"})
