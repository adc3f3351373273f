"""`printctl flow` of a network: its solvers, results and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import typer

from design.hemodynamics.three_d import straighten_edges
from design.hemodynamics.three_d.ranks import rank_conditions, write_case
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from printctl.analysis.flow import NPZ, CsvTables, FlowTables, NpzTables, solve_section
from printctl.analysis.flow.conditions import Driven, driven_by_run, recipe_of
from printctl.analysis.flow.exports import EXPORTS, write_exports
from printctl.analysis.flow.fidelities import Case, solve_fidelities
from printctl.analysis.flow.match import HISTORY, MATCHED, VESSELS, match_and_write, options_from
from printctl.analysis.flow.printed_case import PrintedCase, solve_as_printed
from printctl.analysis.flow.printed_fidelities import mesh_of
from printctl.analysis.flow.ranks import run_on_ranks
from printctl.analysis.flow.three_d import SHARP
from printctl.analysis.networks import load_source
from printctl.cli.flow_options import (
    FlowOutput,
    Match,
    OtherSolvers,
    conditions_said,
    part_of,
    space_of,
)
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.recipe.parts import ThreeDPart


# Solve the flow of `printctl flow` at each requested fidelity (0D, 1D, 3D); write the results.
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


# Run `printctl flow` in 3D on MPI ranks.
CASE = "ranks"


def run_other_solvers(
    network: VesselNetwork,
    driven: Driven,
    space: ThreeDPart,
    out: Path,
    fillet_ratio: float,
    asked: OtherSolvers,
    output: FlowOutput,
) -> None:
    """Do what is asked for; nothing where nothing is.

    Raises
    ------
    FlowError, SolidError, UsageError, PrintctlError, OSError
        As `lumen_mesh`, `run_on_ranks` and the writers.
    """
    if asked.ranks is None:
        return
    mesh = straighten_edges(mesh_of(network, space, fillet_ratio))[0]
    folder = out / CASE
    model: Any = "navier_stokes" if space.inertia else "stokes"
    write_case(mesh, rank_conditions(mesh, driven.steady(network), model=model), folder)
    output.files.append(folder)
    output.summary["ranks"] = _solved(folder, asked.ranks, asked.ranks_python)


def _solved(folder: Path, ranks: int, python: Path | None) -> dict[str, Any]:
    with messages().status(f"3D flow on {ranks} ranks") as status:
        result = run_on_ranks(folder, ranks, python, status.update)
    return {
        "ranks": ranks,
        "pressure_drop_mmhg": float(np.ptp(result.port_pressure)) / PA_PER_MMHG,
    }


FILLET: Final = 0.5
"""Of a network that no recipe rounds."""


def run_network(
    context: typer.Context, network: Path, out: Path, others: OtherSolvers, how: Match
) -> FlowOutput:
    """Solve and write what the options in ``context.params`` ask for.

    Parameters
    ----------
    others, how
        Some of these options, as one value each.

    Raises
    ------
    UsageError
        For options that don't go together.
    FlowError, SolidError, OSError
        As the solvers.
    """
    asked, output = context.params, FlowOutput()
    if asked["as_printed"]:
        run_as_printed(context, network, out, output)
        return output
    if asked["scanned"]:
        raise UsageError("--scanned is for --as-printed --three-d; add these, or leave it out")
    source = load_source(network, asked["unit"], None)
    # Options are a recipe's section under the same names: `part_of` takes them by name.
    if network.is_dir():
        driven, fillet, output.summary["conditions"] = driven_of(context, network, "flow of a run")
    else:
        driven = Driven(part_of(asked)[0])
        fillet = FILLET if asked["fillet_ratio"] is None else asked["fillet_ratio"]
    tables = NpzTables(out / NPZ) if asked["results"] == "npz" else CsvTables(out)
    lumped_and_waves(source.network, driven, tables, output)
    if source.notes:
        output.summary["notes"] = [*source.notes, *output.summary.get("notes", ())]
    output.files = list(tables.files)
    paths = {name: asked[name] for name in EXPORTS if asked[name] is not None}
    space = space_of(asked)
    output.files += write_exports(paths, source.network, driven, space, fillet)
    in_space(source.network, driven, out, fillet, output)
    run_other_solvers(source.network, driven, space, out, fillet, others, output)
    match(source.network, driven, space, out, fillet, how, output)
    return output


# `printctl flow --match-split`: adjust vessel radii until 3D flow divides as wanted.

_PERCENT = 0.5


def match(
    network: VesselNetwork,
    driven: Driven,
    space: ThreeDPart,
    out: Path,
    fillet_ratio: float,
    how: Match,
    output: FlowOutput,
) -> None:
    """Match where it is asked for, and write the adjusted network and its history.

    Raises
    ------
    FlowError, SolidError, UsageError, OSError
        As `Driven.steady` and `match_and_write`.
    """
    if not how.match_split:
        return
    options = options_from(
        _PERCENT if how.match_percent is None else how.match_percent,
        how.least_lumen_mm or 0.0,
        space.edge_ratio,
        max(fillet_ratio, SHARP),
        space.inertia,
    )
    with messages().status("matching the split") as status:
        output.summary["match"] = match_and_write(
            out,
            network,
            driven.steady(network),
            _wanted(how.want or []),
            options,
            lambda _, doing: status.update(f"matching the split: {doing}"),
        )
    output.files += [out / MATCHED, out / HISTORY, out / VESSELS]
    _warn(output)


def _wanted(texts: list[str]) -> dict[int, float]:
    flows: dict[int, float] = {}
    for text in texts:
        node, _, flow = text.partition(",")
        try:
            flows[int(node)] = float(flow)
        except ValueError:
            raise UsageError(f"--want {text!r} isn't NODE,ML_MIN; write 4,0.05") from None
    return flows


def _warn(output: FlowOutput) -> None:
    result = output.summary["match"]
    if result["met"]:
        return
    bounds = result["vessels_at_a_bound"]
    why = f"vessels {bounds} stand at a bound of their radius" if bounds else "rounds bring no more"
    messages().print(
        f"the split isn't met: {result['worst_percent_of_inlet']:.2g} % of the inlet's flow is "
        f"left in vessel {result['worst_vessel']} ({why})",
        style="yellow",
        markup=False,
    )


# `printctl flow RUN --as-printed`: solve the flow in a run's designed and printed lumens.

_ELSEWHERE: Final = (
    "svzerod",
    "svoned",
    "ranks",
    "svmultiphysics",
    "compare",
    "check",
    "results",
)


def run_as_printed(context: typer.Context, folder: Path, out: Path, output: FlowOutput) -> None:
    """Solve and write, by the recipe's conditions and what was typed in their place.

    Raises
    ------
    UsageError
        For a network that is no run folder, options that don't go with --as-printed, and as
        `solve_as_printed`.
    FlowError, SolidError, OSError
        As `solve_as_printed`.
    """
    asked = context.params
    for key in _ELSEWHERE:
        if asked[key] not in (None, False):
            name = key.replace("_", "-")
            raise UsageError(f"--{name} doesn't go with --as-printed; leave one of them out")
    if asked["unit"] not in (None, "mm"):
        raise UsageError(f"a run folder's files are in mm, not {asked['unit']}; drop --unit")
    if asked["scanned"] and not asked["three_d"]:
        raise UsageError("--scanned is for --three-d; add that, or leave it out")
    driven, fillet, said = driven_of(context, folder, "--as-printed")
    case = PrintedCase(folder, driven, fillet, asked["scanned"])
    with messages().status("flow as printed") as status:
        summary, files = solve_as_printed(case, out, status.update)
    output.summary |= {"conditions": said} | summary
    output.files += files


def driven_of(context: typer.Context, folder: Path, what: str) -> tuple[Driven, float, str]:
    """A run's conditions with what was typed in their place, its fillets, and the sentence on it.

    Raises
    ------
    UsageError
        As `recipe_of`, `part_of` and `driven_by_run`.
    """
    asked, recipe = context.params, recipe_of(folder, what)
    part, typed = part_of(asked, recipe.flow, recipe.print_scale)
    ratio = asked["fillet_ratio"]
    fillet = recipe.solid.fillet_ratio if ratio is None else ratio
    driven = driven_by_run(folder, part, recipe.print_scale)
    return driven, fillet, conditions_said(part, typed, recipe.print_scale)
