"""Read and write networks in every supported format; load them from run folders with flow.

Goes in: a path. Comes out: a network with its known flow and tissue.
"""

from __future__ import annotations

import csv
import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.geometry.surface import Surface
from design.hemodynamics import FlowConditions, flow_table, solve_flow
from design.hemodynamics.zero_d.steady import node_inflow
from design.network import VesselNetwork
from design.network_files.by_suffix import READ, UNIT_FIXED, UNIT_NEEDED, WRITERS, read_with_notes
from design.network_files.csv_format import read_network_csv
from design.network_files.merge import NetworkWithNotes
from design.network_files.vtp import write_simvascular_paths
from design.solids import read_solid
from design.solids.files.read import MESHES_WITHOUT_UNIT
from design.units import BLOOD_MPA_S, PA_PER_MMHG, UL_S_PER_ML_MIN, LengthUnit
from kernels.arrays import FloatArray
from printctl.analysis.flow import TABLE, steady_conditions
from printctl.analysis.flow.conditions import driven_by_run, recipe_of
from printctl.analysis.meshes import unit_missing
from printctl.errors import UsageError
from printctl.recipe.parts import FlowPart
from printctl.run_folder.artefacts import NETWORK, NUMBERS, SURFACE
from printctl.run_folder.manifest import Manifest
from printctl.settings import opt, settings
from report.picture import FLOW, GAUGED, VesselQuantities
from report.sections.tables import columns

LOSSES: Final = {
    ".swc": "SWC keeps no numbers of trees and nodes; it is in µm",
    ".vtp": "VTP keeps no numbers of nodes; vessels that meet share a place",
    "": "SimVascular's paths keep no radii and no kinds; they are in cm",
}
"""What a format can't hold, by suffix."""


def read_noted(path: Path, unit: LengthUnit | None, ends: Path | None = None) -> NetworkWithNotes:
    """Read a network, in mm, and say what the user should know of it.

    Parameters
    ----------
    path : Path
        Ends in .csv, .vtp, .swc, .json, .npz or .txt (X-CAVATE's).
    unit : LengthUnit or None
        Of the coordinates, where the format doesn't say it; where it does, None or the same.
    ends : Path, optional
        The file of inlets and outlets that may come with X-CAVATE's.

    Raises
    ------
    UsageError
        Unknown suffix, no such file, unit missing or another than the format's.
    NetworkError, OSError
        As the format's reader.
    """
    suffix = path.suffix.lower()
    if suffix not in READ:
        known = ", ".join(READ)
        raise UsageError(f"{path}: {suffix or 'no suffix'} isn't a network's; {known} are read")
    if ends is not None and suffix != ".txt":
        raise UsageError(f"a file of inlets and outlets goes with X-CAVATE's .txt, not {path}")
    for file in (path, ends):
        if file is not None and not file.is_file():
            raise UsageError(f"{file} isn't there, or no file; check the path")
    require_unit(path, unit)
    if suffix in UNIT_FIXED and unit not in (None, UNIT_FIXED[suffix]):
        raise UsageError(
            f"{path} is in {UNIT_FIXED[suffix]}, as its format says, not {unit}; drop --unit"
        )
    return read_with_notes(path, unit, ends)


def require_unit(path: Path, unit: LengthUnit | None, option: str = "--unit") -> None:
    """Raise `UsageError` naming ``option`` if no unit is given of a file that holds none."""
    if unit is None and path.suffix.lower() in (*UNIT_NEEDED, *MESHES_WITHOUT_UNIT):
        raise unit_missing(path, option)


def check_target(path: Path) -> None:
    """Raise `UsageError` when `write_network` couldn't write a file or folder of this name."""
    suffix = path.suffix.lower()
    if suffix and suffix not in WRITERS:
        raise UsageError(
            f"{path}: {suffix} can't be written; {', '.join(WRITERS)} can, and a name without "
            "suffix is a folder of SimVascular paths"
        )
    if suffix and path.is_dir():
        raise UsageError(f"{path} is a folder; give the name of a file")
    if not suffix and path.exists():
        raise UsageError(f"{path} exists; paths for SimVascular go into a new folder")


def write_network(path: Path, network: VesselNetwork) -> None:
    """Write a network; a name without suffix becomes a folder of SimVascular paths.

    Raises
    ------
    UsageError
        As `check_target`.
    NetworkError
        When the format can't hold the network.
    OSError
        When it can't be written; nothing half-written is left behind.
    """
    check_target(path)
    suffix = path.suffix.lower()
    if suffix:
        WRITERS[suffix](path, network)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
    try:
        write_simvascular_paths(draft, network)
        # A folder for one's own eyes becomes one as any other.
        draft.chmod(0o755)
        draft.rename(path)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


_FLOW: Final = ("flow_ul_s", *FLOW)


@settings
class Drive:
    """Inlet flow and viscosity in place of a run's own, or of the defaults."""

    inlet_flow_ml_min: float | None = opt(
        "In place of a run's own; of a file 0.25 without it.", min=1e-9
    )
    viscosity_mpa_s: float | None = opt(
        f"In place of a run's own; of a file {BLOOD_MPA_S:g}, blood's, without it.", min=1e-6
    )

    def conditions(
        self, network: VesselNetwork, own: FlowConditions | None = None
    ) -> FlowConditions:
        """Conditions of a run, or the defaults, and in their place what is given here.

        Supplies of single trees keep their share of the inlet's flow.
        """
        made = steady_conditions(FlowPart(), network=network) if own is None else own
        if self.inlet_flow_ml_min is not None:
            flow = self.inlet_flow_ml_min * UL_S_PER_ML_MIN
            share = flow / (made.inlet_flow_ul_s or flow)
            supplies = tuple(replace(s, flow_ul_s=share * s.flow_ul_s) for s in made.supplies)
            made = replace(made, inlet_flow_ul_s=flow, inlet_pressure_pa=None, supplies=supplies)
        if self.viscosity_mpa_s is not None:
            made = replace(made, viscosity_pa_s=self.viscosity_mpa_s * 1e-3, fluid=None)
        return made


@dataclass(frozen=True, eq=False)
class Source:
    """A network and what is known of it.

    Attributes
    ----------
    name : str
    network : VesselNetwork
    known : VesselQuantities
    surface : Surface or None
        The tissue's.
    notes : tuple of str
        Sentences for the user: where the flow comes from, what couldn't be read.
    """

    name: str
    network: VesselNetwork
    known: VesselQuantities
    surface: Surface | None
    notes: tuple[str, ...]


def load_source(path: Path, unit: LengthUnit | None, drive: Drive | None) -> Source:
    """Read a run folder or a network's file.

    Parameters
    ----------
    path : Path
    unit : LengthUnit or None
        Of a file that doesn't say it.
    drive : Drive or None
        Where no flow is known or it says a number, flow is solved for so; None: it isn't.

    Raises
    ------
    UsageError
        When there is no such thing, or a file of the run can't be read.
    DesignError, OSError
        As the readers.
    """
    if not path.exists():
        raise UsageError(f"{path} doesn't exist; give a run folder or a network's file")
    if not path.is_dir():
        network, notes = read_noted(path, unit)
        source = Source(path.stem, network, VesselQuantities(), None, notes)
        return source if drive is None else with_flow(source, drive)
    if not (path / NETWORK).is_file():
        raise UsageError(
            f"{path} holds no {NETWORK}, so it is no run folder; `printctl run` or "
            "`printctl design` makes one"
        )
    if unit not in (None, "mm"):
        raise UsageError(f"{path} is a run folder, whose files are in mm, not {unit}; drop --unit")
    return _run(path, drive)


def _run(folder: Path, drive: Drive | None) -> Source:
    network = read_network_csv(folder / NETWORK, unit="mm")
    gauged, notes = _gauged(folder, network.vessel_count)
    flow = _flow(folder, network.vessel_count)
    if flow is None and (folder / TABLE).is_file():
        notes.append(f"{TABLE} isn't that of {NETWORK} and is left out; run the recipe again.")
    surface = read_solid(folder / SURFACE, unit="mm") if (folder / SURFACE).is_file() else None
    name = folder.resolve().name
    source = Source(name, network, VesselQuantities(flow or {}, gauged), surface, tuple(notes))
    if drive is None or (flow and drive == Drive()):
        return source
    return with_flow(source, drive, _own_conditions(folder, network))


def _own_conditions(folder: Path, network: VesselNetwork) -> FlowConditions | None:
    """A run's steady conditions; None where its manifest holds no recipe of this version."""
    if "recipe" not in Manifest.load(folder).facts:
        return None
    recipe = recipe_of(folder, "its flow")
    return driven_by_run(folder, recipe.flow, recipe.print_scale).steady(network)


def _flow(folder: Path, count: int) -> dict[str, FloatArray] | None:
    """Columns of `flow.csv`; None where there is none, or not one row a vessel."""
    path = folder / TABLE
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    if [row.get("vessel") for row in rows] != [str(v) for v in range(count)]:
        return None
    try:
        return {key: np.array([float(row[key]) for row in rows]) for key in _FLOW}
    except (KeyError, TypeError, ValueError):
        return None


def _gauged(folder: Path, count: int) -> tuple[dict[str, FloatArray], list[str]]:
    """What `registration.json` says of each vessel, and what the user should know of it."""
    path = folder / NUMBERS
    if not path.is_file():
        return {}, []
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
        rows: Sequence[Any] = data["vessels"]
        return columns(rows, GAUGED, count), []
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}, [f"{NUMBERS} can't be read and is left out; run the recipe again."]


def with_flow(source: Source, drive: Drive, own: FlowConditions | None = None) -> Source:
    """The same with its flow solved for; where that can't be, a note says why.

    ``own``: the run's conditions, in whose place ``drive`` stands.
    """
    driven = drive.conditions(source.network, own)
    try:
        solution = solve_flow(source.network, driven)
    except FlowError as exc:
        return replace(source, notes=(*source.notes, f"No flow: {exc}."))
    table = flow_table(source.network, solution)
    flow = {key: np.asarray(table[key], dtype=np.float64) for key in _FLOW}
    highest = float(np.abs(solution.pressure).max()) / PA_PER_MMHG
    inflow = float(node_inflow(source.network, solution.flow).clip(min=0.0).sum())
    fluid = "" if driven.fluid is not None else f" of {driven.viscosity_pa_s * 1e3:g} mPa·s"
    note = (
        f"Flow solved for {inflow / UL_S_PER_ML_MIN:.4g} mL/min in all{fluid}, "
        f"{'outlets at 0 mmHg' if own is None else 'all else as the recipe of the run says'}; the "
        f"highest pressure is {highest:.3g} mmHg."
    )
    known = VesselQuantities(flow, source.known.gauged)
    return replace(source, known=known, notes=(*source.notes, note))
