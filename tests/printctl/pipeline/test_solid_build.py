"""Recipe section on the solid: fittings, tubes, chambers, marks."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from design.errors import SolidError
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.solids import block_solid, find_crossings, surface_genus
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.pipeline.run import design_recipe
from printctl.pipeline.solid_build import RunSolids, build
from printctl.recipe.load import parse_recipe
from printctl.recipe.solid import SolidPart
from tests.design.solids.networks import channels, ladder

BARB = {"kind": "barb", "bore_mm": 0.8, "outer_mm": 2.0, "length_mm": 5}


@cache
def plain_block():
    return block_solid((16, 8, 3))


def make(network: VesselNetwork | None = None, **keys: Any) -> RunSolids:
    built = build(SolidPart(**keys), network or ladder(), plain_block(), 0)
    for solid in (built.construct, *([built.chamber] if built.chamber else [])):
        assert len(find_crossings(solid.vertices, solid.faces).pairs) == 0
    assert surface_genus(built.construct.faces) == (built.genus, 1)
    return built


def test_barbs_stand_on_inlet_and_outlet_and_keep_the_lumen_open() -> None:
    built = make(inlets=BARB, outlets=BARB | {"length_mm": 4})
    assert built.construct.bounds[:, 0] == pytest.approx([-5.0, 20.0], abs=1e-3)
    assert built.fittings == 2
    # The bore is 0.8 mm from the tip on: no ray along the axis meets a face.
    faces = built.construct.vertices[built.construct.faces]
    across = np.hypot(faces[..., 1] - 4.1, faces[..., 2] - 1.5)
    assert across[faces[..., 0] < 0].min() == pytest.approx(0.4, abs=2e-3)


def test_a_chamber_has_a_way_in_for_each_port_it_fits() -> None:
    chamber = {"headroom_mm": 3, "inlets": BARB, "outlets": BARB, "ledge_mm": 0.5}
    built = make(chamber=chamber)
    assert built.chamber is not None
    assert surface_genus(built.chamber.faces) == (2, 1)
    assert built.chamber.bounds[:, 0] == pytest.approx([-8.0, 24.0], abs=1e-3)
    bare = make(chamber={"shape": "cylinder"})
    assert bare.chamber is not None
    assert surface_genus(bare.chamber.faces) == (0, 1)


def test_text_and_fiducials_are_cut_into_the_face_they_stand_on() -> None:
    plain = make()
    text = {"text": "A7", "at_mm": (6, 5.5, 3), "height_mm": 1, "depth_mm": 0.2}
    dots = {"at_mm": (5, 0.5, 3), "size_mm": 2, "diameter_mm": 0.4}
    marked = make(texts=[text], fiducials=[dots])
    assert marked.construct.volume_mm3 < plain.construct.volume_mm3
    raised = make(texts=[text | {"engraved": False}])
    assert raised.construct.bounds[1, 2] == pytest.approx(3.19, abs=1e-3)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"texts": [{"text": "A", "at_mm": (6, 5, 9)}]}, r"texts.0: 'A' isn't on the construct"),
        ({"fiducials": [{"at_mm": (5, 0.5, 9)}]}, "put at_mm on its face"),
        ({"inlets": BARB | {"bore_mm": 0.3, "outer_mm": 0.9}}, "isn't wider than the vessel"),
        ({"chamber": {"inlets": BARB | {"outer_mm": 7.0}}}, "over the chamber's rim"),
    ],
)
def test_what_doesnt_fit_is_refused_with_the_key(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(SolidError, match=message):
        make(**keys)


def test_a_construct_that_a_lumen_cuts_in_two_is_refused_with_the_loose_part() -> None:
    across = channels([[8, 0, 1.5], [8, 8, 1.5]], [(0, 1)], 1.6)
    with pytest.raises(
        SolidError, match=r"falls into 2 parts.*of 160 mm³ around \(3\.722, 4, 1\.5"
    ):
        make(across)


@pytest.mark.parametrize(
    ("solid", "message"),
    [
        ({"inlets": BARB | {"bore_mm": 2.5}}, "solid.inlets: bore_mm 2.5 leaves no wall"),
        ({"inlets": {"kind": "luer_male", "bore_mm": 3.2}}, "over 2.9 or 10.5 mm"),
        ({"inlets": {"kind": "hose", "bore_mm": 1}}, "solid.inlets.kind"),
        ({"chamber": {"ledge_mm": 3}}, "ledge_mm 3 isn't below wall_mm 2"),
        ({"texts": [{"text": " ", "at_mm": [0, 0, 0]}]}, "solid.texts.0.text"),
        ({"fiducials": [{"at_mm": [0, 0, 0], "along": [0, 0, 2]}]}, "must be two directions"),
        ({"formats": ["stl", "stl"]}, "names one twice"),
        ({"formats": ["iges"]}, "solid.formats"),
        ({"walls": 1}, "solid.walls"),
    ],
)
def test_a_recipe_is_told_what_is_wrong_with_it(solid: dict[str, Any], message: str) -> None:
    recipe = {
        "schema": 1,
        "name": "x",
        "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
        "vasculature": {"design": "planar_four_vessel"},
        "solid": solid,
    }
    with pytest.raises(RecipeError) as told:
        parse_recipe(recipe, "x.yaml")
    assert message in str(told.value)


# --- notes on constructs whose handles or open ends differ from the network's
def test_vessels_that_merge_are_told_by_number_and_place(tmp_path: Path) -> None:
    """Two channels side by side, whose lumens become one; a foreign network has 329 such places."""
    ends = np.array([(0.0, 3, 2), (10, 3, 2), (0, 3.6, 2), (10, 3.6, 2)])
    told = design_notes(tmp_path, ends, 0.4)
    assert "vessels merge that the network keeps apart: 0 and 1 by 0.2 mm at (" in told
    assert told.count("0 and 1 by") == 1
    assert "break through" not in told


@pytest.mark.parametrize(
    ("first", "last", "radius", "said"),
    [
        ((0.0, 3.0, 2.0), (10.0, 3.0, 2.0), 0.4, ""),
        ((0.0, 3.0, 0.2), (10.0, 3.0, 0.2), 0.4, "vessel 0 by 0.2 mm at ("),
        ((2.0, 3.0, 2.0), (8.0, 3.0, 2.0), 0.4, "vessel 0 at (2, 3, 2) mm, 2 mm below it"),
    ],
)
def test_broken_walls_and_closed_lumens_are_told(
    tmp_path: Path, first: tuple[float, ...], last: tuple[float, ...], radius: float, said: str
) -> None:
    told = design_notes(tmp_path, np.array([first, last]), radius)
    assert ("handles, the network" in told or "0 ports" in told) == bool(said)
    assert said in told


def design_notes(tmp_path: Path, ends: FloatArray, radius: float) -> str:
    """Design straight vessels between pairs of `ends` in a block; return the run's manifest."""
    n = len(ends) // 2
    zeros = np.zeros(n, dtype=np.int64)
    pairs = np.arange(2 * n).reshape(-1, 2)
    network = VesselNetwork.from_segments(ends, pairs, np.full(n, radius), zeros, zeros)
    write_network_csv(tmp_path / "n.csv", network)
    data = {
        "schema": 1,
        "name": "n",
        "tissue": {"shape": "block", "size_mm": [10, 6, 4]},
        "vasculature": {"network": "n.csv", "unit": "mm", "overlaps": "tell"},
        "toolpath": {"method": "embedded"},
        "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    }
    recipe = parse_recipe(data, "n.yaml")
    design_recipe(recipe, tmp_path, tmp_path / "run", Console(quiet=True))
    return (tmp_path / "run" / "manifest.json").read_text()
