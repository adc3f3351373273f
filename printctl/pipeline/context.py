"""Shared state of the pipeline stages: recipe, profiles, folder, computed values.

A value is read from the run folder when the stage that makes it was reused, so that a resumed
run and an uninterrupted one go on from the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics import FlowConditions, same_shear_conditions, scaled_network
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.solids import Solid, read_solid
from design.tissue import Tissue
from design.toolpath.correction import NEUTRAL, Corrections
from firmware_profiles import (
    Bath,
    Dish,
    Ink,
    Needle,
    Printer,
    Syringe,
    load,
    steady_flow,
    supported_diameter_mm,
)
from printctl.analysis.flow.outlets import steady_conditions
from printctl.corrections.compensation import (
    CompensationFile,
    corrections_of_file,
    load_compensation,
)
from printctl.pipeline.job.heads import Filled, filled_heads, vessel_heads
from printctl.pipeline.plate_plan import WellDish, varied_ink
from printctl.pipeline.printability import Printability, embedded_limits, fresh_limits
from printctl.pipeline.tissue_source import make_tissue
from printctl.progress import StageBars
from printctl.recipe import Recipe
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from printctl.recipe.sections.toolpath import Embedded, Fresh
from printctl.run_folder.artefacts import LUMEN, NETWORK, SOLID
from printctl.run_folder.manifest import Manifest, digest_file

LIGHT_REACHES_MM = 3.5
"""Deeper parts are beyond OCT in scattering gels; the planar part, 3 mm, is at its limit."""


@dataclass
class RunContext:
    """One run of one recipe in one folder.

    Of a run over a plate ``stand`` is the well in which the part stands, ``ink_changes`` what is
    varied there of the ink's profile, ``title`` goes before the stages' names on the screen, and
    ``siblings`` are the runs of other wells, whose stages are taken over where nothing differs.
    With ``printed`` nothing is printed: the print that is done in the folder is taken. The printer
    of a rehearsal is ``rehearsal_speed`` times as fast as a real one, 0 for as fast as it can; None
    where it is no rehearsal.
    """

    recipe: Recipe
    recipe_folder: Path
    folder: Path
    manifest: Manifest
    bars: StageBars
    assume_yes: bool = False
    reused: set[str] = field(default_factory=set)
    stand: WellDish | None = None
    ink_changes: Mapping[str, Any] = field(default_factory=dict)
    title: str = ""
    siblings: Sequence[RunContext] = ()
    printed: bool = False
    rehearsal_speed: float | None = None
    trial: bool = False

    def digests(self, names: Sequence[str]) -> dict[str, str]:
        """SHA-256 of each of the user's files, named relative to the recipe, that is there."""
        files = {name: self.recipe_folder / name for name in names}
        return {name: digest_file(path) for name, path in files.items() if path.is_file()}

    @cached_property
    def printer(self) -> Printer:
        """The printer's profile."""
        return load(Printer, self.recipe.printer.profile)

    @cached_property
    def needle(self) -> Needle:
        """The needle on it; the first of several heads'."""
        return self.loads[0].needle

    @cached_property
    def syringe(self) -> Syringe:
        """The syringe in it; in the first of several heads."""
        return self.loads[0].syringe

    @cached_property
    def ink(self) -> Ink:
        """What is in that syringe."""
        return self.loads[0].ink

    @cached_property
    def loads(self) -> tuple[Filled, ...]:
        """What each head holds; of a printer with one the recipe's syringe, ink and needle.

        Raises
        ------
        UsageError
            When the recipe names other heads than the printer has.
        """
        part, needle = self.recipe.printer, self.recipe.toolpath.needle
        ink = None if part.heads else varied_ink(self.profile_ink, self.ink_changes)
        return filled_heads(part, needle, self.printer, ink)

    @cached_property
    def profile_ink(self) -> Ink:
        """The one head's ink as its profile says it, whatever a plate varies."""
        return load(Ink, self.recipe.printer.ink)

    @property
    def poured(self) -> Filled:
        """What is really in the first head: a plate varies what is believed of an ink, not it."""
        first = self.loads[0]
        return Filled(first.syringe, self.profile_ink, first.needle) if self.ink_changes else first

    @cached_property
    def vessel_head(self) -> NDArray[np.int64]:
        """The head that writes each vessel, (v,): by tree, else by kind, else the one for the rest.

        Raises
        ------
        UsageError
            For a vessel that no head is to write.
        """
        return vessel_heads(self.network, self.recipe.printer.heads)

    def printability(self, asked_mm: float | None = None) -> Printability:
        """Limits of the recipe's way of printing, in the design's size."""
        part, scale = self.recipe.toolpath, self.recipe.print_scale
        if isinstance(part, Fresh):
            return fresh_limits(part, scale, asked_mm)
        held = supported_diameter_mm(self.bath, self.ink)
        return embedded_limits(part, scale, self.needle, held, asked_mm)

    @cached_property
    def bath(self) -> Bath:
        """What is in the dish."""
        return load(Bath, self.recipe.printer.bath)

    @cached_property
    def dish(self) -> Dish | None:
        """What the bath is in, where the recipe says it."""
        if self.stand is not None:
            return self.stand.dish
        name = self.recipe.printer.dish
        return None if name is None else load(Dish, name)

    @property
    def bath_depth_mm(self) -> float | None:
        """How high the dish or well is filled, where the recipe says it."""
        if self.stand is not None:
            return self.stand.bath_mm
        return self.recipe.printer.bath_depth_mm

    @cached_property
    def flows_ul_s(self) -> tuple[float, ...]:
        """What each pneumatic head lays while its valve is open; empty for plungers."""
        return tuple(
            steady_flow(head, one.ink, one.needle).ul_s
            for head, one in zip(self.printer.airs, self.loads, strict=False)
        )

    @property
    def flow_ul_s(self) -> float | None:
        """The same of the first head; None for a plunger."""
        return next(iter(self.flows_ul_s), None)

    @cached_property
    def tissue(self) -> Tissue:
        """The tissue in the design's size, made anew from its source."""
        return make_tissue(self.recipe.tissue, self.recipe_folder)

    @cached_property
    def scan_part(self) -> FileScan | SimulatedScan:
        """What the recipe says of the scan; by default OCT, or micro-CT for what is too deep."""
        if self.recipe.scan is not None:
            return self.recipe.scan
        low, high = self.bounds
        if high[2] - low[2] > LIGHT_REACHES_MM or isinstance(self.recipe.toolpath, Embedded):
            return SimulatedScan(simulated="microct")
        return SimulatedScan(simulated="oct")

    @cached_property
    def network(self) -> VesselNetwork:
        """The network in the print's size, as it stands in the run folder."""
        return read_network_csv(self.folder / NETWORK, unit="mm")

    @cached_property
    def designed_network(self) -> VesselNetwork:
        """The same in the design's size."""
        return scaled_network(self.network, 1 / self.recipe.print_scale)

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the tissue in the print's size, (2, 3), mm."""
        return self.tissue.bounds * self.recipe.print_scale

    @cached_property
    def conditions(self) -> FlowConditions:
        """What drives the print's flow: the recipe's, at the wall shear of the design's size."""
        return same_shear_conditions(self.designed_conditions, self.recipe.print_scale)

    @cached_property
    def designed_conditions(self) -> FlowConditions:
        """The recipe's, in the design's size."""
        return steady_conditions(self.recipe.flow, self.recipe_folder, self.designed_network)

    @property
    def outlets_digest(self) -> dict[str, str]:
        """SHA-256 of the table of outlets by its name; empty without one."""
        name = self.recipe.flow.outlets
        return {} if name is None else self.digests([name])

    @cached_property
    def lumen(self) -> Solid:
        """The lumens as a solid, in the tissue's frame."""
        return read_solid(self.folder / LUMEN, unit="mm")

    @cached_property
    def solid(self) -> Solid:
        """The construct (body minus lumens), in the tissue's frame."""
        return read_solid(self.folder / SOLID, unit="mm")

    @cached_property
    def compensation(self) -> CompensationFile | None:
        """What earlier prints asked for, where the recipe names it."""
        name = self.recipe.toolpath.compensation
        return None if name is None else load_compensation(self.recipe_folder / name)

    @property
    def compensation_digest(self) -> dict[str, str]:
        """SHA-256 of that file by its name; empty without one."""
        name = self.recipe.toolpath.compensation
        return {} if name is None else self.digests([name])

    @cached_property
    def corrections(self) -> Corrections:
        """What that changes; nothing without one."""
        return NEUTRAL if self.compensation is None else corrections_of_file(self.compensation)

    @cached_property
    def local_network(self) -> VesselNetwork:
        """The network with its lumens corrected, not yet stretched."""
        return self.corrections.locally(self.network)

    @cached_property
    def written_network(self) -> VesselNetwork:
        """The network as it is to be written, in the tissue's frame."""
        return self.corrections.stretch.network(self.local_network)

    @cached_property
    def written_bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the tissue as it is written, (2, 3), mm."""
        return self.corrections.stretch.points(self.bounds)

    @cached_property
    def place_mm(self) -> NDArray[np.float64]:
        """Where the part's origin stands in the printer's frame, (3,), mm.

        By default the part's middle is in the middle of the work area, or of its well, and its
        lowest point one floor clearance of the bath above the dish.
        """
        if self.recipe.printer.place_mm is not None:
            return np.array(self.recipe.printer.place_mm)
        low, high = self.bounds
        centre = None if self.stand is None else self.stand.centre_mm
        return default_place(low, high, self.printer, self.bath, centre)

    @cached_property
    def start_mm(self) -> NDArray[np.float64]:
        """Where the tip stands before the print, printer's frame, (3,), mm.

        Touched off by the operator: homing is blocked while the needle stands in the bath. The
        point lies above the middle of the part, clear of it.
        """
        low, high = self.bounds + self.place_mm
        top = self.written_bounds[1, 2] + self.place_mm[2]
        clear = top + 5.0 if self.stand is None else max(top + 5.0, self.stand.safe_z_mm)
        above = min(clear, self.printer.z_mm.high)
        return np.round(np.append((low + high)[:2] / 2, above), 3)


def default_place(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    printer: Printer,
    bath: Bath,
    centre_mm: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """Where a part with these lowest and highest corners is put, (3,), mm, printer's frame.

    Its middle at ``centre_mm``, by default in the middle of the work area, its lowest point one
    floor clearance of the bath above the dish.
    """
    spans = (printer.x_mm, printer.y_mm)
    middle = np.array(centre_mm or [(span.low + span.high) / 2 for span in spans])
    floor = printer.z_mm.low + bath.floor_clearance_mm
    # Whole microns, so that the numbers in the G-code stay short.
    return np.asarray(np.round(np.append(middle - (low + high)[:2] / 2, floor - low[2]), 3))
