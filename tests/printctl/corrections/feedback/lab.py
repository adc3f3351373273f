"""Simulated laboratory: a printer and scanner of known errors, as registration results.

Prints come out `shrink` times as large as written, with lumens wider by `spread_mm` and, of single
vessels, by `faults_mm`, and axes pushed by `push_mm`, the same in every print; `noise_mm` differs
from print to print. Nothing of the product's estimation is in here.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.toolpath.correction import NEUTRAL, Corrections
from printctl.corrections.compensation import (
    CompensationFile,
    DesignPart,
    PrintConditions,
    PrintPart,
)
from printctl.corrections.compensation import corrections_of_file as corrections_of
from printctl.corrections.feedback import Print
from printctl.pipeline.running.run import toolpath_recipe
from printctl.recipe import parse_recipe
from printctl.run_folder.artefacts import NUMBERS
from printctl.run_folder.manifest import Manifest, StageRecord, digest_file
from tests.made_once import made_once
from tests.printctl.networks import vessels

SHA = "0" * 64
SECTION_MM = 0.1


def ladder(rungs: int = 8) -> VesselNetwork:
    """Two rails along x, and rungs of 0.4 to 0.8 mm between them along y, 4 mm long."""
    x = 2.0 * np.arange(rungs)
    low, high = ([(a, y, 1.5) for a in x] for y in (0.0, 4.0))
    rails = [(k, k + 1) for k in range(rungs - 1)]
    rails += [(rungs + a, rungs + b) for a, b in rails]
    rung = [(k, rungs + k) for k in range(rungs)]
    width = [1.0] * len(rails) + list(np.linspace(0.4, 0.8, rungs))
    ends = np.array([*rails, *rung])
    return VesselNetwork.from_segments(
        np.array([*low, *high]), ends, np.array(width) / 2,
        np.full(len(ends), 4), np.zeros(len(ends)),
    )  # fmt: skip


@dataclass
class Lab:
    """Faults of a printer and its ink, and what the scan knows of depth."""

    network: VesselNetwork = field(default_factory=ladder)
    shrink: tuple[float, float, float] = (0.975, 0.975, 0.975)
    spread_mm: float = 0.0
    faults_mm: dict[int, float] = field(default_factory=dict)
    push_mm: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    noise_mm: float = 0.002
    depth_standard: bool = False
    defects: list[dict[str, Any]] = field(default_factory=list)
    prints: int = 0

    def diameters(self, written: Corrections) -> np.ndarray:
        """Of every vessel as it comes out, (v,), mm."""
        lumens = written.written(self.network)
        wide = 2 * np.array([radius.mean() for _, radius in lumens.polylines()])
        wide = wide * np.mean(self.shrink) + self.spread_mm
        for vessel, more in self.faults_mm.items():
            wide[vessel] += more
        return wide

    def places(self, written: Corrections) -> np.ndarray:
        """Of every node as it comes out, once the part's own size is taken out, (m, 3), mm."""
        moved = written.node_offsets(self.network)
        for node, push in self.push_mm.items():
            moved[node] += push
        return moved

    def print(self, made: CompensationFile | None = None, voxel_um: float = 25.0) -> Print:
        """Print with a compensation, scan, register."""
        self.prints += 1
        rng = np.random.default_rng(self.prints)
        written = NEUTRAL if made is None else corrections_of(made)
        size = np.array(self.shrink) * written.stretch.factor + rng.normal(0, 2e-4, 3)
        found = {
            "ambiguity": {"flag": False, "margin": 3.0},
            "scale": size.tolist(),
            "depth_scale_fitted": True,
            "measured_by": {
                "modality": "oct", "voxel_um": [voxel_um] * 3, "optical_depth": True,
                "depth_standard": self.depth_standard,
            },
            "defects": self.defects,
            "vessels": self._rows(written, rng),
        }  # fmt: skip
        return Print(
            facts=PrintPart(
                folder=f"run{self.prints}", recipe_sha256=SHA,
                registration_sha256=f"{self.prints:064x}",
                scan_sha256=f"{self.prints:064x}", scale=tuple(size.tolist()),
                scale_interval_95=(4e-4, 4e-4, 1e-3),
            ),
            design=DesignPart(
                network_sha256=SHA, solid_sha256=SHA, bounds_mm=((-1, -1, 0), (15, 5, 3))
            ),
            made_with=PrintConditions(method="fresh", printer="a", needle="b", ink="c", bath="d"),
            network=self.network,
            base=written,
            found=found,
            simulated=False,
        )  # fmt: skip

    def _rows(self, written: Corrections, rng: np.random.Generator) -> list[dict[str, Any]]:
        wide = self.diameters(written) + rng.normal(0, self.noise_mm, self.network.vessel_count)
        moved = self.places(written)
        rows = []
        for vessel, (points, _) in enumerate(self.network.polylines()):
            length = float(np.linalg.norm(points[-1] - points[0]))
            way = (points[-1] - points[0]) / length
            along = np.arange(0.6, length - 0.6, SECTION_MM)
            first, last = self.network.vessel_nodes[vessel]
            share = (along / length)[:, None]
            shift = (1 - share) * moved[first] + share * moved[last]
            shift = shift - (shift @ way)[:, None] * way + rng.normal(0, 1e-3, shift.shape)
            seen = wide[vessel] + rng.normal(0, 2e-3, len(along))
            rows.append(
                {
                    "vessel": vessel, "length_mm": length, "along_mm": along.tolist(),
                    "diameter_um": (1e3 * seen).tolist(),
                    "noise_um": [2.0] * len(along), "shift_along_um": (1e3 * shift).tolist(),
                }
            )  # fmt: skip
        return rows


# --- small recipe run up to its G-code, with a synthetic registration
TWO = vessels(
    [[0, 1.3, 1], [6, 1.3, 1]], [[0, 2.7, 1], [6, 2.7, 1]], radius=[0.3, 0.4], kind=4, tree=[0, 1]
)
"""Channels of 0.6 and 0.8 mm through a block of 6 x 4 x 2 mm, 0.7 mm of wall between them."""


def recipe_of(method: str = "fresh", **changes: Any) -> dict[str, Any]:
    """The recipe's sections; ``changes`` are the toolpath's."""
    toolpath: dict[str, Any] = {"method": method}
    if method == "embedded":
        toolpath["needle"] = "30g"
    return {
        "schema": 1,
        "name": "two",
        "tissue": {"shape": "block", "size_mm": [6, 4, 2]},
        "vasculature": {"network": "two.csv", "unit": "mm"},
        "toolpath": toolpath | changes,
        "printer": {"bath": "gelatin_support" if method == "fresh" else "cell_matrix"}
        | ({} if method == "fresh" else {"ink": "gelatin_sacrificial"}),
    }


def run(folder: Path, name: str, data: dict[str, Any]) -> dict[str, Any]:
    """Run a recipe in ``folder`` up to the lumens' check; its summaries."""
    write_network_csv(folder / "two.csv", TWO)
    recipe = parse_recipe(data, f"{name}.yaml")
    return toolpath_recipe(recipe, folder, folder / name, Console(quiet=True))


def small_run(factory: pytest.TempPathFactory) -> Path:
    """Return a folder with that recipe's run, `plain`: a copy of the first worker's."""

    def make() -> Path:
        folder = factory.mktemp("small_run")
        run(folder, "plain", recipe_of())
        return folder

    return Path(
        shutil.copytree(made_once(factory, "small_run", make), factory.mktemp("copy") / "runs")
    )


def registered(run_folder: Path, lab: Lab) -> None:
    """Put into a run what registration would have found of a print by ``lab``."""
    found = lab.print().found | {
        "interval_95": {"scale": [4e-4, 4e-4, None]},
        "depth_scale_fitted": False,
    }
    (run_folder / NUMBERS).write_text(json.dumps(found))
    manifest = Manifest.load(run_folder)
    outputs = {NUMBERS: digest_file(run_folder / NUMBERS)}
    manifest.stages["registration"] = StageRecord("key", outputs, {}, 0.0, 0.0)
    manifest.save()
