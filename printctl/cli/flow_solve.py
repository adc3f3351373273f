"""Solve the flow of `printctl flow` at each requested fidelity (0D, 1D, 3D); write the results."""

from __future__ import annotations

from pathlib import Path

from design.hemodynamics import write_svoned
from design.hemodynamics.zero_d.svzerod import write_svzerod
from design.network import VesselNetwork
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages
from printctl.flow import (
    FlowTables,
    one_d_options,
    pulsatile_conditions,
    solve_section,
    steady_conditions,
)
from printctl.flow.fidelities import Case, solve_fidelities
from printctl.recipe.parts import FlowPart
from printctl.recipe.waves import OneDPart


def lumped_and_waves(
    network: VesselNetwork, part: FlowPart, tables: FlowTables, output: FlowOutput
) -> None:
    """Solve 0D and 1D flow and write their tables; see `solve_section`."""
    with messages().status("0D flow") as status:

        def tell(cycle: int, change: float, _: float) -> None:
            status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

        output.summary |= solve_section(tables, network, part, tell)[1]


def write_problems(
    network: VesselNetwork,
    part: FlowPart,
    svzerod: Path | None,
    svoned: Path | None,
    output: FlowOutput,
) -> None:
    """Write the pulsatile problem for other solvers, where it is asked for.

    Raises
    ------
    FlowError, UsageError, OSError
        As `pulsatile_conditions`, `write_svzerod` and `write_svoned`.
    """
    if part.pulse is None or svzerod is svoned is None:
        return
    conditions = pulsatile_conditions(part, part.pulse, Path(), network=network)
    if svzerod is not None:
        write_svzerod(svzerod, network, conditions, part.pulse.steps)
        output.files.append(svzerod)
    if svoned is not None:
        options = one_d_options(part.one_d or OneDPart(), part.pulse.steps)
        write_svoned(svoned, network, conditions, options)
        output.files.append(svoned)


def in_space(
    network: VesselNetwork, part: FlowPart, out: Path, fillet_ratio: float, output: FlowOutput
) -> None:
    """Resolve the flow in space and compare fidelities, as far as the section asks for it.

    Raises
    ------
    FlowError, SolidError, UsageError, OSError
        As `solve_fidelities`.
    """
    if part.three_d is None and part.compare is None:
        return
    pulse = None
    if part.pulse is not None:
        pulse = pulsatile_conditions(part, part.pulse, Path(), network=network)
    case = Case(network, part, steady_conditions(part, Path(), network), pulse, fillet_ratio)
    with messages().status("3D flow") as status:
        done = solve_fidelities(out, case, lambda _, doing: status.update(f"3D flow: {doing}"))
    output.summary |= done.summary
    output.files += [out / name for name in done.files]
