"""Recipe section on tissue: zones, demand, label images; errors named with their place."""

from typing import Any

import pytest

from printctl.errors import RecipeError
from printctl.recipe import parse_recipe
from printctl.recipe.tissue import CylinderPart, DepthDemandPart, MeshPart

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
