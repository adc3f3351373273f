"""Solve a run's flow with designed and printed lumens, with 95 % intervals."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.special import ndtri

from design.files import write_text
from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d.engine import load_engine
from design.hemodynamics.three_d.meshing.mesh import SurfaceOptions, surface_mesh
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from kernels.arrays import FloatArray
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.printed.as_printed import (
    OpenPart,
    even_radii,
    open_part,
    printed_lumens,
    read_print,
)
from printctl.analysis.flow.printed.printed_fidelities import (
    FlowIntervals,
    Pair,
    VesselFlow,
    in_space,
    lumped,
    mean_one_d,
    mesh_of,
    printed_summary,
    printed_table,
)
from printctl.analysis.flow.printed.scanned import scanned_lumen
from printctl.analysis.flow.solve import one_d_options, shear_band
from printctl.analysis.flow.tables import write_columns
from printctl.errors import UsageError
from printctl.recipe.parts import OneDPart, ThreeDPart
from printctl.run_folder.artefacts import NETWORK
from registration.measuring.gauging import with_printed_lengths

DRAWS: Final = 400
PERCENTILES: Final = (2.5, 97.5)
_K: Final = float(ndtri(0.975))


@dataclass(frozen=True)
class LumenErrors:
    """Relative standard uncertainty of each vessel's radius, as it conducts; (v,) each.

    Attributes
    ----------
    shared : float64
        What errs alike in all vessels (type B: walls, index, voxel size).
    own : float64
        What doesn't (type A).
    known : bool
        False where a measured diameter's interval was withdrawn, or an older registration has
        none: no flow of the network has an interval then.
    """

    shared: FloatArray
    own: FloatArray
    known: bool


def lumen_errors(rows: Sequence[Mapping[str, Any]]) -> LumenErrors:
    """Read the errors of a registration's vessels from their resistances' intervals.

    R goes as r⁻⁴, so that a relative error of r is a quarter of R's. A vessel that wasn't measured
    is taken as wide as the others' median error makes it: it errs as they do in the mean, and by
    their scatter about it besides.

    Parameters
    ----------
    rows : sequence of mapping
        ``vessels`` of registration.json.
    """
    relative = np.array([_relative(row) for row in rows])
    part = np.array([_shared_part(row) for row in rows])
    measured = np.array([any(row.get("diameter_um") or ()) for row in rows])
    known = bool(np.isfinite(relative[measured]).all()) and bool(measured.any())
    if not known:
        return LumenErrors(np.zeros(len(rows)), np.zeros(len(rows)), False)
    shared, own = relative * np.sqrt(part), relative * np.sqrt(1.0 - part)
    off = [0.01 * row["error_percent"] for row in rows if row.get("error_percent") is not None]
    scatter = float(np.std(off, ddof=1)) if len(off) > 1 else 0.0
    usual = float(np.mean(shared[measured]))
    guessed = float(np.hypot(np.mean(own[measured]), scatter))
    return LumenErrors(np.where(measured, shared, usual), np.where(measured, own, guessed), True)


def _relative(row: Mapping[str, Any]) -> float:
    """Relative standard uncertainty of a vessel's radius; NaN without an interval."""
    ends = row.get("resistance_ratio_interval_95") or [None, None]
    if None in ends or min(ends) <= 0:
        return float("nan")
    return float(np.log(ends[1] / ends[0]) / (2 * _K) / 4)


def _shared_part(row: Mapping[str, Any]) -> float:
    """Share of a vessel's variance that all vessels have in common; all of it where unknown."""
    terms = row.get("budget") or []
    if not terms:
        return 1.0
    return float(np.clip(sum(t["share"] for t in terms if t["type"] == "B"), 0.0, 1.0))


def flow_intervals(
    part: OpenPart, conditions: FlowConditions, errors: LumenErrors, count: int
) -> FlowIntervals | None:
    """Draw lumens within their errors and solve 0D flow in each (JCGM 101:2008).

    Parameters
    ----------
    part : OpenPart
        What flow can run through.
    conditions : FlowConditions
        Of that part.
    errors : LumenErrors
        Of the design's vessels.
    count : int
        Vessels of the design.

    Returns
    -------
    FlowIntervals or None
        By the design's numbers; None where a lumen's interval isn't known.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    if not errors.known:
        return None
    rng = np.random.default_rng(0)
    alike = rng.standard_normal(DRAWS)
    apart = rng.standard_normal((DRAWS, len(part.vessel)))
    shared, own = errors.shared[part.vessel], errors.own[part.vessel]
    factors = np.exp(alike[:, None] * shared + apart * own)
    drawn = [
        lumped(_widened(part.network, factor), conditions).of_design(part, count)
        for factor in factors
    ]
    names = [f.name for f in fields(FlowIntervals)]
    return FlowIntervals(*(_ends([getattr(one, name) for one in drawn]) for name in names))


def _widened(network: VesselNetwork, factor: FloatArray) -> VesselNetwork:
    return replace(network, radius=network.radius * np.repeat(factor, np.diff(network.offset)))


def _ends(values: Sequence[Any]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # closed vessels resist without end in every draw
        low, high = np.percentile(np.array(values), PERCENTILES, axis=0, method="nearest")
    return np.array([low, high])


def carry_intervals(
    intervals: FlowIntervals, lumped_flow: VesselFlow, other: VesselFlow
) -> FlowIntervals:
    """Intervals of another fidelity: the lumped one's, relative to its value, about the other's.

    Shares keep the width of theirs, because a share may be nothing.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        made = {
            name: getattr(intervals, name) / getattr(lumped_flow, name) * getattr(other, name)
            for name in ("resistance", "flow", "wall_shear", "drop_pa", "inflow_ul_s")
        }
    made["flow"] = np.sort(made["flow"], axis=0)
    return FlowIntervals(**made, share=intervals.share - lumped_flow.share + other.share)


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
