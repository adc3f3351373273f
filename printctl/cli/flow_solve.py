"""Solve the flow of `printctl flow` at each requested fidelity (0D, 1D, 3D); write the results."""

from __future__ import annotations

from pathlib import Path

from design.hemodynamics import write_svoned
from design.hemodynamics.zero_d.svzerod import write_svzerod
from design.network import VesselNetwork
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages
from printctl.flow import (
    ONE_D,
    ONE_D_WAVES,
    PULSES,
    TABLE,
    WAVES,
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


def steady(network: VesselNetwork, part: FlowPart, out: Path, found: FlowOutput) -> None:
    """Solve the steady flow and write its table.

    Raises
    ------
    FlowError, UsageError, OSError
        As `steady_conditions` and `solve_steady`.
    """
    _, summary = solve_steady(out, network, steady_conditions(part, Path(), network), part)
    found.summary |= summary
    found.files.append(out / TABLE)


def pulsatile(
    network: VesselNetwork, part: FlowPart, out: Path, svzerod: Path | None, found: FlowOutput
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
    found.summary["pulsatile"] = solve_and_write(out, network, conditions, part.pulse.steps)
    found.files += [out / PULSES, out / WAVES]
    if svzerod is not None:
        write_svzerod(svzerod, network, conditions, part.pulse.steps)
        found.files.append(svzerod)


def waves(
    network: VesselNetwork, part: FlowPart, out: Path, svoned: Path | None, found: FlowOutput
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

            found.summary["one_d"] = solve_and_write_one_d(out, network, conditions, options, tell)
        found.files += [out / ONE_D, out / ONE_D_WAVES]
    if svoned is not None:
        write_svoned(svoned, network, conditions, options)
        found.files.append(svoned)


def space(
    network: VesselNetwork, part: FlowPart, out: Path, fillet_ratio: float, found: FlowOutput
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
    found.summary |= done.summary
    found.files += [out / name for name in done.files]
