"""Recipe section on forests: what is implied, and what is refused with a remedy."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from printctl.errors import RecipeError
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.forest import Forest

ROOT = Path(__file__).parents[3]
ARTERY, VEIN, LYMPH = ({"kind": kind} for kind in ("artery", "vein", "lymph"))


def recipe_of(networks: list[Any], flow: dict[str, Any] | None = None, **keys: Any) -> Recipe:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = {"grow": "forest", "terminals": 9, "networks": networks, **keys}
    data["flow"] = flow or {}
    return parse_recipe(data, "test.yaml")


def test_arteries_and_veins_make_loops_and_a_single_tree_none() -> None:
    fed = {"supplies": [{"trees": [2], "flow_ml_min": 0.1}], "density_g_cm3": 1.02}
    part = recipe_of(
        [{"trees": [ARTERY, VEIN]}, {"trees": [LYMPH]}, {"network": "old.csv", "unit": "mm"}], fed
    ).vasculature
    assert isinstance(part, Forest)
    assert [one.how for one in part.grown] == ["loops", "none"]
    assert [tree.kind for tree in part.trees] == ["artery", "vein", "lymph"]
    assert part.files() == ["old.csv"]


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
        recipe_of(networks, **keys)
