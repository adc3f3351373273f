"""Flow of one network in all fidelities asked for: lumped, waves, in space, on ranks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.hemodynamics.three_d import straighten_edges
from design.hemodynamics.three_d.ranks import RankOptions, write_case
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.fidelities import Case, solve_fidelities
from printctl.analysis.flow.printed.printed_fidelities import mesh_of
from printctl.analysis.flow.ranks import run_on_ranks
from printctl.analysis.flow.solve import solve_section
from printctl.analysis.flow.tables import FlowTables
from printctl.recipe.parts import ThreeDPart

RANKS: Final = "ranks"
Tell = Callable[[str], None]


@dataclass
class FlowOutput:
    """Numbers, those of other fidelities in dicts, files, and what spoils a result."""

    summary: dict[str, Any] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class NetworkFlow:
    """A network, what drives it, and where results go.

    Attributes
    ----------
    network : VesselNetwork
    driven : Driven
    space : ThreeDPart
        Of ranks, which solve in space by their own.
    out : Path
        Folder that is written to.
    fillet_ratio : float
        Of the lumens in space.
    tell : callable
        Notified of what is being solved.
    output : FlowOutput
        What the methods add to.
    """

    network: VesselNetwork
    driven: Driven
    space: ThreeDPart
    out: Path
    fillet_ratio: float
    tell: Tell
    output: FlowOutput

    def lumped_and_waves(self, tables: FlowTables) -> None:
        """Solve 0D and 1D flow and write their tables."""

        def tell(cycle: int, change: float, _: float) -> None:
            self.tell(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

        self.tell("0D flow")
        self.output.summary |= solve_section(
            tables,
            self.network,
            self.driven.part,
            tell,
            steady=self.driven.steady(self.network),
            folder=self.driven.folder,
            print_scale=self.driven.print_scale,
        )[1]

    def in_space(self) -> None:
        """Resolve the flow in space and compare fidelities, as far as the section asks for it."""
        part, network = self.driven.part, self.network
        if part.three_d is None and part.compare is None:
            return
        self.tell("3D flow")
        steady, pulsatile = self.driven.steady(network), self.driven.pulsatile(network)
        case = Case(network, part, steady, pulsatile, self.fillet_ratio)
        done = solve_fidelities(self.out, case, lambda _, doing: self.tell(f"3D flow: {doing}"))
        self.output.summary |= done.summary
        if done.notes:
            self.output.summary["notes"] = [*self.output.summary.get("notes", ()), *done.notes]
        self.output.files += [self.out / name for name in done.files]

    def on_ranks(self, ranks: int, python: Path | None) -> None:
        """Solve in space on several MPI processes."""
        mesh = straighten_edges(mesh_of(self.network, self.space, self.fillet_ratio))[0]
        folder = self.out / RANKS
        model: Any = "navier_stokes" if self.space.inertia else "stokes"
        write_case(mesh, self.driven.steady(self.network), folder, RankOptions(model))
        self.output.files.append(folder)
        self.tell(f"3D flow on {ranks} ranks")
        result = run_on_ranks(folder, ranks, python, self.tell)
        drop = float(np.ptp(result.port_pressure)) / PA_PER_MMHG
        self.output.summary["ranks"] = {"ranks": ranks, "pressure_drop_mmhg": drop}
