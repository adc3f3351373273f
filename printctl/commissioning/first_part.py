"""First part of a commissioning: a forked lumen in a block with fiducials, sized by the needle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml
from rich.console import Console

from design.files import write_text
from firmware_profiles import Bath, Needle, Printer, load
from printctl.errors import PrintctlError
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.job import load_job
from printctl.machine.records.mounting import MountedParts
from printctl.pipeline.running.run import RunOptions, run_recipe
from printctl.recipe import load_recipe
from printctl.run_folder.artefacts import GCODE

RECIPE: Final = "recipe.yaml"
NETWORK: Final = "lumen.csv"
RUN: Final = "run"
SCAN: Final = {"simulated": "oct", "shrink_percent": 1.0}
"""Of the simulated printer; of a real one nobody reads it before a scan is given."""
LAYER_PER_BORE: Final = 0.4
"""Layer height over the needle's bore; FRESH prints use 0.3 to 0.5."""


@dataclass(frozen=True)
class FirstPart:
    """Measures of the part, mm, for a needle's bore.

    Its three lumens have different diameters and the fork isn't symmetric, so that a scan fits in
    one pose only.
    """

    bore_mm: float

    @property
    def lumens_mm(self) -> tuple[float, float, float]:
        """Diameters of trunk and branches: three bores at least, and what OCT resolves."""
        thin = max(0.45, 3.0 * self.bore_mm)
        return round(1.5 * thin, 2), round(1.25 * thin, 2), round(thin, 2)

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Length, width and height of the block."""
        trunk = self.lumens_mm[0]
        return round(7 + 5 * trunk, 2), round(3 + 5 * trunk, 2), round(1 + 3 * trunk, 2)

    def network(self) -> str:
        """Return the lumens as CSV, as `printctl run` reads them."""
        length, width, height = self.size_mm
        z, fork = height / 2, 0.35 * length
        near, far, bend = 0.24 * width, 0.72 * width, 0.6 * length
        points = [(0, width / 2), (fork, width / 2), (bend, far), (length, far)]
        points += [(bend, near), (length, near)]
        pieces = [(0, 0, 1, 0), (1, 1, 2, 1), (1, 2, 3, 1), (2, 1, 4, 2), (2, 4, 5, 2)]
        rows = ["vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"]
        for vessel, first, last, size in pieces:
            (x0, y0), (x1, y1) = points[first], points[last]
            radius = self.lumens_mm[size] / 2
            ends = f"{x0:.3f},{y0:.3f},{z:.3f},{x1:.3f},{y1:.3f},{z:.3f}"
            rows.append(f"{vessel},{first},{last},{ends},{radius:.4f},{radius:.4f},artery,0")
        return "\n".join(rows) + "\n"

    def fiducials(self) -> list[dict[str, Any]]:
        """Return three dimples on the top face, beside the lumens."""
        _, width, height = self.size_mm
        dimple = round(max(0.5, 2.5 * self.bore_mm), 2)
        at = [round(2 * dimple, 2), round(0.12 * width, 2), height]
        return [{"at_mm": at, "size_mm": round(4 * dimple, 2), "diameter_mm": dimple}]


def write_first_part(
    folder: Path,
    printer: str,
    port: str,
    parts: MountedParts,
    scan: dict[str, Any],
    **toolpath: Any,
) -> Path:
    """Write the part's recipe and network into ``folder``; return the recipe.

    Parameters
    ----------
    folder : Path
    printer, port : str
        Profile, and the port that the recipe names.
    parts : MountedParts
        Syringe, needle, ink, dish with its centre, and bath.
    scan : dict
        The recipe's section ``scan``.
    **toolpath
        More keys of its section ``toolpath``.
    """
    needle = load(Needle, parts.needle)
    made = FirstPart(needle.inner_mm)
    length, width, _ = made.size_mm
    floor = load(Printer, printer).z_mm.low
    section: dict[str, Any] = {"profile": printer, "port": port}
    section |= {"syringe": parts.syringe, "ink": parts.ink, "bath": parts.bath}
    if parts.dish:
        section |= {"dish": parts.dish, "bath_depth_mm": parts.depth_mm}
    if parts.dish_centre_mm is not None:
        x, y = parts.dish_centre_mm
        clear = load(Bath, parts.bath).floor_clearance_mm
        section["dish_centre_mm"] = [x, y]
        place = (x - length / 2, y - width / 2, floor + clear)
        section["place_mm"] = [round(mm, 3) for mm in place]
    recipe = {
        "schema": 1,
        "name": "first_part",
        "seed": 1,
        "tissue": {"shape": "block", "size_mm": list(made.size_mm)},
        "vasculature": {"network": NETWORK, "unit": "mm"},
        "flow": {"viscosity_mpa_s": 1.0, "inlet_flow_ml_min": 0.25},
        "solid": {"fiducials": made.fiducials()},
        "toolpath": {
            "method": "fresh",
            "needle": parts.needle,
            "layer_um": round(1e3 * LAYER_PER_BORE * needle.inner_mm),
            "line_um": round(1e3 * needle.inner_mm),
            **toolpath,
        },
        "printer": section,
        "scan": scan,
        "registration": {"tolerance_um": round(700 * needle.inner_mm)},
    }
    write_text(folder / NETWORK, made.network())
    path = folder / RECIPE
    write_text(path, yaml.safe_dump(recipe, sort_keys=False, allow_unicode=True))
    return path


def run_part(recipe: Path, how: RunOptions) -> dict[str, Any]:
    """Run the part's recipe in the folder beside it, silently; see `run_recipe`."""
    console = Console(quiet=True)
    return run_recipe(load_recipe(recipe), recipe.parent, recipe.parent / RUN, console, how)


def slice_first_part(
    folder: Path, printer: str, port: str, parts: MountedParts
) -> tuple[Path, tuple[float, float, float]]:
    """Design and slice the part with all checks; return its G-code and where the tip starts, mm.

    Raises
    ------
    PrintctlError, DesignError
        When a check refuses it.
    """
    run_part(write_first_part(folder, printer, port, parts, SCAN), RunOptions(until="lumens"))
    gcode = folder / RUN / GCODE
    start = declared_start(load_job(gcode, load(Printer, printer)))
    if start is None:
        raise PrintctlError(f"{gcode} doesn't declare where the tip starts (G92)")
    return gcode, start
