"""Oxygen: recipe section `oxygen` and `printctl oxygen`."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from design.solids import Solid, write_stl
from design.tissue import block
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.design_run import DESIGN
from printctl.pipeline.facts import recipe_facts
from printctl.pipeline.stage import wanted_stages
from printctl.pipeline.stages import oxygen as stage
from printctl.progress import StageBars
from printctl.recipe import Recipe, parse_recipe
from printctl.run_folder.manifest import Manifest
from registration.report.page import report_html
from tests.system.cli import called as printctl

FORK = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,3,3,0,3,3,2,0.4,0.4,artery,0\n"
    "1,1,2,3,3,2,4,5,5,0.2,0.2,artery,0\n"
    "2,1,3,3,3,2,2,1,5,0.2,0.2,artery,0\n"
)
BASE = {
    "schema": 1,
    "name": "ox",
    "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
    "vasculature": {"design": "planar_four_vessel"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Solved once, and looked at from several sides."""
    found = tmp_path_factory.mktemp("fork")
    (found / "fork.csv").write_text(FORK)
    surface = block((6.0, 6.0, 6.0))
    write_stl(found / "cube.stl", Solid(surface.vertices, surface.faces))
    done = printctl(
        "oxygen", "fork.csv", "--unit", "mm", "--tissue", "cube.stl", "--tissue-unit", "mm",
        "--cells-per-ml", "3e6", "--grid-cells", "8000", "--inlet-flow-ml-min", "0.01", "--json",
        cwd=found,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (found / "said.json").write_text(done.stdout)
    return found


def test_the_command_leaves_numbers_table_field_and_picture(folder: Path) -> None:
    found = json.loads((folder / "said.json").read_text())
    assert found == json.loads((folder / "oxygen" / "oxygen.json").read_text())
    assert found["imbalance"] < 1e-6
    assert 0.0 < found["hypoxic_percent"] < 100.0
    assert found["cells_fed_at_most"] == pytest.approx(0.01 / 0.06 * 0.2 / 5e-8, rel=1e-6)
    with (folder / "oxygen" / "oxygen.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert float(rows[0]["oxygen_in_millimolar"]) == pytest.approx(0.2)
    # Equal branches in a symmetric cube, and mixed alike.
    assert rows[1]["oxygen_in_millimolar"] == rows[2]["oxygen_in_millimolar"]
    assert float(rows[1]["oxygen_out_millimolar"]) < float(rows[0]["oxygen_out_millimolar"])
    for name in ("oxygen.vti", "oxygen.svg"):
        assert (folder / "oxygen" / name).stat().st_size > 1000


def test_the_report_says_what_it_rests_on(folder: Path) -> None:
    found = json.loads((folder / "said.json").read_text())
    picture = (folder / "oxygen" / "oxygen.svg").read_bytes()
    page = report_html({"oxygen": found}, [], None, {"oxygen/Slice": picture})
    assert 'id="oxygen"' in page
    assert "given by the user" in page
    assert "Buchwald 2009" in page
    assert "Share of the tissue by its oxygen" in page
    assert "oxygen" not in report_html({"flow": {"inflow_ml_min": 1.0}}, [], None, {}).lower()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cells-per-ml", "-1"), "--cells-per-ml"),
        (("--spacing-um", "1"), "raise the spacing"),
        (("--tissue", "none.stl"), "none.stl"),
        (("--spacing-um", "200", "--grid-cells", "2000"), "--spacing-um or --grid-cells"),
    ],
)
def test_what_makes_no_sense_is_refused(folder: Path, options: tuple[str, ...], words: str) -> None:
    given = {"--tissue": "cube.stl", "--tissue-unit": "mm"}
    given |= dict(zip(options[::2], options[1::2], strict=True))
    flat = [word for pair in given.items() for word in pair]
    done = printctl("oxygen", "fork.csv", "--unit", "mm", *flat, cwd=folder)
    assert done.returncode != 0
    assert words in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def _context(recipe: Recipe, folder: Path) -> RunContext:
    bars = StageBars(Console(file=io.StringIO()))
    return RunContext(recipe, folder, folder, Manifest.load(folder), bars)


def test_a_recipe_without_the_section_has_neither_stage_nor_word(tmp_path: Path) -> None:
    plain = parse_recipe(BASE, "test")
    asked = parse_recipe({**BASE, "oxygen": {"cells_per_ml": 1e6}}, "test")
    assert "oxygen" not in recipe_facts(plain)
    assert recipe_facts(asked)["oxygen"]["cells_per_ml"] == 1e6
    assert stage.STAGE not in wanted_stages(_context(plain, tmp_path), DESIGN)
    assert stage.STAGE in wanted_stages(_context(asked, tmp_path), DESIGN)


def test_a_section_taken_out_is_forgotten(tmp_path: Path) -> None:
    context = _context(parse_recipe(BASE, "test"), tmp_path)
    context.manifest.stages["oxygen"] = None  # type: ignore[assignment]
    wanted_stages(context, DESIGN)
    assert "oxygen" not in context.manifest.stages


def test_the_stage_depends_on_section_flow_and_scale(tmp_path: Path) -> None:
    def told(**sections: object) -> object:
        return stage.depends(_context(parse_recipe({**BASE, **sections}, "test"), tmp_path))

    one = told(oxygen={})
    assert one == told(oxygen={"cells_per_ml": 1e7})
    assert one != told(oxygen={"cells_per_ml": 2e7})
    assert one != told(oxygen={}, flow={"inlet_flow_ml_min": 1.0})
    assert one != told(oxygen={}, print_scale=2)
    wave = {"pulse": {"amplitude_ml_min": 0.1, "period_s": 1}}
    assert one == told(oxygen={}, flow=wave)
    behind = {"outlet": {"resistance_mmhg_min_ml": 4}}
    assert told(oxygen={}, flow=behind) == told(oxygen={}, flow={"pulse": wave["pulse"] | behind})
    assert one != told(oxygen={}, flow=behind)


def test_a_misspelt_key_is_refused() -> None:
    with pytest.raises(RecipeError, match=r"oxygen\.cell_density"):
        parse_recipe({**BASE, "oxygen": {"cell_density": 1e7}}, "test")
