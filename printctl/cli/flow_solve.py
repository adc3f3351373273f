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
    solve_and_write,
    solve_and_write_one_d,
    solve_steady,
    steady_conditions,
)
from printctl.flow.fidelities import Case, solve_fidelities
from printctl.recipe.parts import FlowPart
from printctl.recipe.waves import OneDPart


def steady(network: VesselNetwork, part: FlowPart, tables: FlowTables, output: FlowOutput) -> None:
    """Solve the steady flow and write its table.

    Raises
    ------
    FlowError, UsageError, OSError
        As `steady_conditions` and `solve_steady`.
    """
    _, summary = solve_steady(tables, network, steady_conditions(part, Path(), network), part)
    output.summary |= summary


def pulsatile(
    network: VesselNetwork,
    part: FlowPart,
    tables: FlowTables,
    svzerod: Path | None,
    output: FlowOutput,
) -> None:
    """Solve for the periodic state where the section asks for a pulse, and write its tables.

    Raises
    ------
    FlowError, UsageError, OSError
        As `pulsatile_conditions`, `solve_and_write` and `write_svzerod`.
    """
    if part.pulse is None:
        return
    conditions = pulsatile_conditions(part, part.pulse, Path(), network=network)
    output.summary["pulsatile"] = solve_and_write(tables, network, conditions, part.pulse.steps)
    if svzerod is not None:
        write_svzerod(svzerod, network, conditions, part.pulse.steps)
        output.files.append(svzerod)


def waves(
    network: VesselNetwork,
    part: FlowPart,
    tables: FlowTables,
    svoned: Path | None,
    output: FlowOutput,
) -> None:
    """Follow the pulse along vessels where the section asks for it, and write its tables.

    Raises
    ------
    FlowError, UsageError, OSError
        As `pulsatile_conditions`, `solve_and_write_one_d` and `write_svoned`.
    """
    if part.pulse is None:
        return
    conditions = pulsatile_conditions(part, part.pulse, Path(), network=network)
    options = one_d_options(part.one_d or OneDPart(), part.pulse.steps)
    if part.one_d is not None:
        with messages().status("1D flow") as status:

            def tell(cycle: int, change: float) -> None:
                status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

            output.summary["one_d"] = solve_and_write_one_d(
                tables, network, conditions, options, tell
            )
    if svoned is not None:
        write_svoned(svoned, network, conditions, options)
        output.files.append(svoned)


def space(
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
