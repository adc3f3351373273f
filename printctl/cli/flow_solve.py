"""Solve the flow of `printctl flow` at each requested fidelity (0D, 1D, 3D); write the results."""

from __future__ import annotations

from pathlib import Path

from design.network import VesselNetwork
from printctl.analysis.flow import FlowTables, solve_section
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.fidelities import Case, solve_fidelities
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages


def lumped_and_waves(
    network: VesselNetwork, driven: Driven, tables: FlowTables, output: FlowOutput
) -> None:
    """Solve 0D and 1D flow and write their tables; see `solve_section`."""
    with messages().status("0D flow") as status:

        def tell(cycle: int, change: float, _: float) -> None:
            status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

        output.summary |= solve_section(
            tables,
            network,
            driven.part,
            tell,
            steady=driven.steady(network),
            folder=driven.folder,
            print_scale=driven.print_scale,
        )[1]


def in_space(
    network: VesselNetwork, driven: Driven, out: Path, fillet_ratio: float, output: FlowOutput
) -> None:
    """Resolve the flow in space and compare fidelities, as far as the section asks for it.

    Raises
    ------
    FlowError, SolidError, UsageError, OSError
        As `solve_fidelities`.
    """
    part = driven.part
    if part.three_d is None and part.compare is None:
        return
    case = Case(network, part, driven.steady(network), driven.pulsatile(network), fillet_ratio)
    with messages().status("3D flow") as status:
        done = solve_fidelities(out, case, lambda _, doing: status.update(f"3D flow: {doing}"))
    output.summary |= done.summary
    output.files += [out / name for name in done.files]
