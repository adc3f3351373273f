"""Solve a run's flow twice, with designed and with printed lumens; write both."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from design.files import write_text
from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d.engine import load_engine
from design.hemodynamics.three_d.mesh import SurfaceOptions, surface_mesh
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from printctl.analysis.flow.as_printed import (
    OpenPart,
    even_radii,
    open_part,
    printed_lumens,
    read_print,
)
from printctl.analysis.flow.driven import Driven
from printctl.analysis.flow.one_d import one_d_options
from printctl.analysis.flow.printed_fidelities import (
    Pair,
    VesselFlow,
    in_space,
    lumped,
    mean_one_d,
    mesh_of,
    printed_summary,
    printed_table,
)
from printctl.analysis.flow.printed_intervals import (
    DRAWS,
    LumenErrors,
    carry_intervals,
    flow_intervals,
    lumen_errors,
)
from printctl.analysis.flow.scanned import scanned_lumen
from printctl.analysis.flow.steady import shear_band
from printctl.analysis.flow.tables import write_columns
from printctl.errors import UsageError
from printctl.recipe.space import ThreeDPart
from printctl.recipe.waves import OneDPart
from printctl.run_folder.artefacts import NETWORK
from registration.measuring.gauging import with_printed_lengths

AS_PRINTED, SUMMARY = "flow_as_printed.csv", "flow_as_printed.json"


@dataclass(frozen=True)
class PrintedCase:
    """Inputs of a flow solution in a printed network.

    Attributes
    ----------
    folder : Path
        Of the run.
    driven : Driven
        With ``one_d`` and ``three_d`` where these are asked for.
    fillet_ratio : float
        Of the lumens.
    scanned : bool
        Solve 3D in the scan's own surface.
    """

    folder: Path
    driven: Driven
    fillet_ratio: float
    scanned: bool = False


def solve_as_printed(
    case: PrintedCase, out: Path, tell: Callable[[str], None]
) -> tuple[dict[str, Any], list[Path]]:
    """Solve each fidelity twice, write `AS_PRINTED` and `SUMMARY`; summary and files.

    Raises
    ------
    UsageError
        Without a registration, a pulse for 1D, or a surface for --scanned.
    FlowError, SolidError, OSError
        As the solvers and writers, and when nothing is open.
    """
    if case.driven.part.three_d is not None:
        load_engine()  # Missing, it is better told before minutes of work.
    design = read_network_csv(case.folder / NETWORK, unit="mm")
    rows, scale = read_print(case.folder)
    printed = printed_lumens(design, rows)
    on_design = open_part(printed, design)
    part = replace(on_design, network=with_printed_lengths(on_design.network, scale))
    tell("intervals of 0D flow")
    pairs = {"0D": _steady(case, design, part, lumen_errors(rows))}
    if case.driven.part.one_d is not None:
        tell("1D flow")
        pairs["1D"] = _waves(case, case.driven.part.one_d, design, part)
    if case.driven.part.three_d is not None:
        lumens = on_design if case.scanned else part  # `scanned_lumen` moves the axes itself
        pairs["3D"] = _space(case, case.driven.part.three_d, design, lumens, tell)
    pairs |= {name: _with_ends(pairs["0D"], pair) for name, pair in pairs.items() if name != "0D"}
    summary = printed_summary(printed, pairs, shear_band(case.driven.part))
    summary["interval_95"] = _intervals_said(pairs["0D"])
    summary["lumens_3d"] = _lumens_said(case)
    out.mkdir(parents=True, exist_ok=True)
    write_columns(out / AS_PRINTED, printed_table(design, printed, pairs))
    write_text(out / SUMMARY, json.dumps(summary, indent=1) + "\n")
    return summary, [out / AS_PRINTED, out / SUMMARY]


def _lumens_said(case: PrintedCase) -> str:
    if case.driven.part.three_d is None:
        return "not solved"
    return "the scan's surface" if case.scanned else "round, of the measured diameters"


def _intervals_said(pair: Pair) -> str:
    if pair.ends is None:
        return "not known: a measured lumen has no 95 % interval; register the scan again"
    return (
        f"95 %, {DRAWS} draws of the lumens within their measured intervals, solved in 0D and "
        "carried to the other fidelities in proportion"
    )


def _with_ends(steady: Pair, pair: Pair) -> Pair:
    if steady.ends is None:
        return pair
    return replace(pair, ends=carry_intervals(steady.ends, steady.printed, pair.printed))


def _steady(case: PrintedCase, design: VesselNetwork, part: OpenPart, errors: LumenErrors) -> Pair:
    conditions, count = case.driven.steady(design), design.vessel_count
    printed = lumped(part.network, part.steady(conditions))
    ends = flow_intervals(part, part.steady(conditions), errors, count)
    return Pair(lumped(design, conditions), printed.of_design(part, count), ends)


def _waves(case: PrintedCase, how: OneDPart, design: VesselNetwork, part: OpenPart) -> Pair:
    pulse, conditions = case.driven.part.pulse, case.driven.pulsatile(design)
    if pulse is None or conditions is None:
        raise UsageError(
            "--one-d follows a pulse, and the recipe has none; give --amplitude-ml-min, --shape "
            "or --waveform, with --wall-young-kpa"
        )
    options = one_d_options(how, pulse.steps)
    printed = mean_one_d(part.network, part.pulsatile(conditions), options)
    return Pair(
        mean_one_d(design, conditions, options), printed.of_design(part, design.vessel_count)
    )


def _space(
    case: PrintedCase,
    how: ThreeDPart,
    design: VesselNetwork,
    part: OpenPart,
    tell: Callable[[str], None],
) -> Pair:
    conditions = case.driven.steady(design)
    tell("3D flow as designed")
    designed = in_space(design, mesh_of(design, how, case.fillet_ratio), conditions, how)
    tell("3D flow as printed")
    return Pair(
        designed,
        _in_printed_space(case, how, part, part.steady(conditions)).of_design(
            part, design.vessel_count
        ),
    )


def _in_printed_space(
    case: PrintedCase, how: ThreeDPart, part: OpenPart, conditions: FlowConditions
) -> VesselFlow:
    even = even_radii(part.network)
    if not case.scanned:
        return in_space(even, mesh_of(even, how, case.fillet_ratio), conditions, how)
    seen = scanned_lumen(case.folder, even)
    fine = SurfaceOptions(edge_ratio=how.edge_ratio)
    mesh = surface_mesh(seen.surface.vertices, seen.surface.faces, seen.network, fine)
    return in_space(seen.network, mesh, conditions, how)
