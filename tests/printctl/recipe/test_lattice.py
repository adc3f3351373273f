"""Recipe section on lattices."""

from typing import Any, get_args

import pytest

from design.lattices import LatticeKind
from printctl.errors import RecipeError
from printctl.recipe import parse_recipe
from printctl.recipe.model import LatticeNetwork

BLOCK = {"shape": "block", "size_mm": [16, 8, 8]}


def parsed(**lattice: Any) -> LatticeNetwork:
    part = {"lattice": "grid", "cell_mm": 3.0, "diameter_mm": 0.6, **lattice}
    data = {"schema": 1, "name": "x", "tissue": BLOCK, "vasculature": part}
    found = parse_recipe(data, "recipe.yaml").vasculature
    assert isinstance(found, LatticeNetwork)
    return found


@pytest.mark.parametrize("kind", get_args(LatticeKind))
def test_every_lattice_can_be_asked_for(kind: str) -> None:
    assert parsed(lattice=kind).options().kind == kind


def test_diameters_become_radii() -> None:
    options = parsed(manifold_diameter_mm=1.2, axis="x", clearance_mm=0.2).options()
    assert (options.radius_mm, options.manifold_mm, options.axis) == (0.3, 0.6, "x")
    assert options.clearance_mm == 0.2
    # Half as wide again where the recipe doesn't say.
    assert parsed().options().manifold_mm == pytest.approx(0.45)


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
