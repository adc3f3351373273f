"""`printctl flow` of a network: its solvers, results and figures."""

from __future__ import annotations

from dataclasses import dataclass
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
from printctl.analysis.flow.typed_over import conditions_said
from printctl.analysis.networks import load_source
from printctl.cli.flow_options import FlowOutput, Match, OtherSolvers, part_of, space_of
from printctl.cli.options import messages, print_warning
from printctl.errors import UsageError
from printctl.recipe.parts import ThreeDPart

RANKS: Final = "ranks"
FILLET: Final = 0.5
"""Of a network that no recipe rounds."""
_PERCENT: Final = 0.5


def run_network(
    context: typer.Context, network: Path, out: Path, others: OtherSolvers, how: Match
) -> FlowOutput:
    """Solve and write what the options in ``context.params`` ask for; some are ``others``, ``how``.

    Raises
    ------
    UsageError
        For options that don't go together.
    FlowError, SolidError, OSError
        As the solvers.
    """
    requested, output = context.params, FlowOutput()
    if requested["as_printed"]:
        _as_printed(context, network, out, output)
        return output
    if requested["scanned"]:
        raise UsageError("--scanned is for --as-printed --three-d; add these, or leave it out")
    source = load_source(network, requested["unit"], None)
    # Options are a recipe's section under the same names: `part_of` takes them by name.
    if network.is_dir():
        driven, fillet, output.summary["conditions"] = driven_of(context, network, "flow of a run")
    else:
        driven = Driven(part_of(requested)[0])
        fillet = FILLET if requested["fillet_ratio"] is None else requested["fillet_ratio"]
    tables = NpzTables(out / NPZ) if requested["results"] == "npz" else CsvTables(out)
    made = _NetworkFlow(source.network, driven, space_of(requested), out, fillet, output)
    made.lumped_and_waves(tables)
    if source.notes:
        output.summary["notes"] = [*source.notes, *output.summary.get("notes", ())]
    output.files = list(tables.files)
    paths = {name: requested[name] for name in EXPORTS if requested[name] is not None}
    output.files += write_exports(paths, source.network, driven, made.space, fillet)
    made.in_space()
    if others.ranks is not None:
        made.on_ranks(others.ranks, others.ranks_python)
    if how.match_split:
        made.matched(how)
    return output


@dataclass(frozen=True)
class _NetworkFlow:
    """A network, what drives it, and where results go."""

    network: VesselNetwork
    driven: Driven
    space: ThreeDPart
    out: Path
    fillet_ratio: float
    output: FlowOutput

    def lumped_and_waves(self, tables: FlowTables) -> None:
        """Solve 0D and 1D flow and write their tables."""
        with messages().status("0D flow") as status:

            def tell(cycle: int, change: float, _: float) -> None:
                status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

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
        steady, pulsatile = self.driven.steady(network), self.driven.pulsatile(network)
        case = Case(network, part, steady, pulsatile, self.fillet_ratio)
        with messages().status("3D flow") as status:
            done = solve_fidelities(
                self.out, case, lambda _, doing: status.update(f"3D flow: {doing}")
            )
        self.output.summary |= done.summary
        self.output.files += [self.out / name for name in done.files]

    def on_ranks(self, ranks: int, python: Path | None) -> None:
        """Solve in space on several MPI processes."""
        mesh = straighten_edges(mesh_of(self.network, self.space, self.fillet_ratio))[0]
        folder = self.out / RANKS
        model: Any = "navier_stokes" if self.space.inertia else "stokes"
        steady = self.driven.steady(self.network)
        write_case(mesh, rank_conditions(mesh, steady, model=model), folder)
        self.output.files.append(folder)
        with messages().status(f"3D flow on {ranks} ranks") as status:
            result = run_on_ranks(folder, ranks, python, status.update)
        drop = float(np.ptp(result.port_pressure)) / PA_PER_MMHG
        self.output.summary["ranks"] = {"ranks": ranks, "pressure_drop_mmhg": drop}

    def matched(self, how: Match) -> None:
        """Adjust radii until 3D flow divides as wanted; write the network and its history."""
        options = options_from(
            _PERCENT if how.match_percent is None else how.match_percent,
            how.least_lumen_mm or 0.0,
            self.space.edge_ratio,
            max(self.fillet_ratio, SHARP),
            self.space.inertia,
        )
        with messages().status("matching the split") as status:
            result = match_and_write(
                self.out,
                self.network,
                self.driven.steady(self.network),
                _wanted(how.want or []),
                options,
                lambda _, doing: status.update(f"matching the split: {doing}"),
            )
        self.output.summary["match"] = result
        self.output.files += [self.out / name for name in (MATCHED, HISTORY, VESSELS)]
        if not result["met"]:
            bounds = result["vessels_at_a_bound"]
            why = f"vessels {bounds} stand at a bound of their radius" if bounds else ""
            print_warning(
                f"the split isn't met: {result['worst_percent_of_inlet']:.2g} % of the inlet's "
                f"flow is left in vessel {result['worst_vessel']} "
                f"({why or 'rounds bring no more'})"
            )


def _wanted(texts: list[str]) -> dict[int, float]:
    flows: dict[int, float] = {}
    for text in texts:
        node, _, flow = text.partition(",")
        try:
            flows[int(node)] = float(flow)
        except ValueError:
            raise UsageError(f"--want {text!r} isn't NODE,ML_MIN; write 4,0.05") from None
    return flows


_ELSEWHERE: Final = (
    *("svzerod", "svoned", "ranks", "svmultiphysics"),
    *("compare", "check", "results"),
)


def _as_printed(context: typer.Context, folder: Path, out: Path, output: FlowOutput) -> None:
    """Solve by the recipe's conditions and what was typed in their place."""
    requested = context.params
    for key in _ELSEWHERE:
        if requested[key] not in (None, False):
            name = key.replace("_", "-")
            raise UsageError(f"--{name} doesn't go with --as-printed; leave one of them out")
    if requested["unit"] not in (None, "mm"):
        raise UsageError(f"a run folder's files are in mm, not {requested['unit']}; drop --unit")
    if requested["scanned"] and not requested["three_d"]:
        raise UsageError("--scanned is for --three-d; add that, or leave it out")
    driven, fillet, stated = driven_of(context, folder, "--as-printed")
    case = PrintedCase(folder, driven, fillet, requested["scanned"])
    with messages().status("flow as printed") as status:
        summary, files = solve_as_printed(case, out, status.update)
    output.summary |= {"conditions": stated} | summary
    output.files += files


def driven_of(context: typer.Context, folder: Path, what: str) -> tuple[Driven, float, str]:
    """A run's conditions with what was typed in their place, its fillets, a sentence on it."""
    requested, recipe = context.params, recipe_of(folder, what)
    part, typed = part_of(requested, recipe.flow, recipe.print_scale)
    ratio = requested["fillet_ratio"]
    fillet = recipe.solid.fillet_ratio if ratio is None else ratio
    driven = driven_by_run(folder, part, recipe.print_scale)
    return driven, fillet, conditions_said(part, typed, recipe.print_scale)
