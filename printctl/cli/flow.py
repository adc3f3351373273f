"""`printctl flow`: steady and pulsatile flow in any network, and svZeroDSolver's cases."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from design.hemodynamics import (
    FlowConditions,
    flow_summary,
    question_pressure,
    solve_flow,
    write_flow_csv,
)
from design.hemodynamics.zero_d.svzerod import (
    read_svzerod,
    run_svzerod,
    write_svzerod,
    write_svzerod_csv,
)
from design.network import VesselNetwork
from design.units import UL_S_PER_ML_MIN
from printctl.cli.flow_one_d import (
    CellOption,
    OneDFlag,
    SvonedOption,
    WallViscosityOption,
    follow_waves,
    one_d_part,
)
from printctl.cli.network_options import SourceArg, UnitOption
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.errors import UsageError
from printctl.flow import PULSES, WAVES, pulsatile_conditions, solve_and_write
from printctl.networks import Drive, load_source
from printctl.pipeline.stages.flow import TABLE
from printctl.recipe.parts import FlowPart
from printctl.recipe.pulse import PulsePart

CASE = "svzerod.csv"


def flow(
    network: SourceArg,
    unit: UnitOption = None,
    out: Annotated[
        Path, typer.Option("--out", help="Folder for the tables; made where it isn't.")
    ] = Path("flow"),
    inlet_flow_ml_min: Annotated[
        float, typer.Option("--inlet-flow-ml-min", min=1e-9, help="Mean, of all inlets.")
    ] = 0.25,
    viscosity_mpa_s: Annotated[float, typer.Option("--viscosity-mpa-s", min=1e-6)] = 1.0,
    amplitude_ml_min: Annotated[
        float | None, typer.Option("--amplitude-ml-min", help="Of a sine about the mean.")
    ] = None,
    shape: Annotated[
        str | None, typer.Option("--shape", help="ejection or roller_pump, scaled to the mean.")
    ] = None,
    waveform: Annotated[
        Path | None, typer.Option("--waveform", help="CSV with time_s, flow_ml_min.")
    ] = None,
    period_s: Annotated[float | None, typer.Option("--period-s", help="Of a cycle.")] = None,
    wall_young_kpa: Annotated[
        float | None, typer.Option("--wall-young-kpa", help="Of the gel around; else rigid.")
    ] = None,
    wall_thickness_mm: Annotated[
        float | None, typer.Option("--wall-thickness-mm", help="Of free tubes, not in gel.")
    ] = None,
    profile: Annotated[
        str, typer.Option("--profile", help="Of the pulse: womersley or poiseuille.")
    ] = "womersley",
    steps: Annotated[int, typer.Option("--steps", help="Of a cycle.")] = 100,
    svzerod: Annotated[
        Path | None,
        typer.Option("--svzerod", help="Write the pulsatile problem for svZeroDSolver, too."),
    ] = None,
    one_d: OneDFlag = False,
    cell_mm: CellOption = None,
    wall_viscosity_pa_s: WallViscosityOption = None,
    svoned: SvonedOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Solve the flow in a network; in pulses, too, where a wave is given.

    An input file of svZeroDSolver (.json) is stepped through its cycles instead.
    """
    if is_svzerod(network):
        _run_case(network, out, as_json)
        return
    source = load_source(network, unit, Drive(inlet_flow_ml_min, viscosity_mpa_s))
    part = _part(
        inlet_flow_ml_min=inlet_flow_ml_min,
        viscosity_mpa_s=viscosity_mpa_s,
        pulse={
            "amplitude_ml_min": amplitude_ml_min,
            "shape": shape,
            "table": None if waveform is None else str(waveform.resolve()),
            "period_s": period_s,
            "wall_young_kpa": wall_young_kpa,
            "wall_thickness_mm": wall_thickness_mm,
            "profile": profile,
            "steps": steps,
        },
    )
    waves = one_d_part(one_d, cell_mm, wall_viscosity_pa_s, part.pulse is not None)
    if part.pulse is None and (svzerod or svoned) is not None:
        name = "--svoned" if svzerod is None else "--svzerod"
        raise UsageError(f"{name} writes a pulsatile problem; give --amplitude-ml-min, --shape "
                         "or --waveform")  # fmt: skip
    found, files = _steady(source.network, part, out)
    if part.pulse is not None:
        conditions = pulsatile_conditions(part, part.pulse, Path())
        found["pulsatile"] = solve_and_write(out, source.network, conditions, part.pulse.steps)
        files += [out / PULSES, out / WAVES]
        if svzerod is not None:
            write_svzerod(svzerod, source.network, conditions, part.pulse.steps)
            files.append(svzerod)
        found["one_d"], more = follow_waves(
            out, source.network, conditions, waves, part.pulse.steps, svoned
        )
        files += more
    _say(found, files, as_json)


def is_svzerod(path: Path) -> bool:
    """Whether a file is an input of svZeroDSolver."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(data, dict) and {"boundary_conditions", "vessels"} <= set(data)


def _part(pulse: dict[str, Any], **flow_section: Any) -> FlowPart:
    """The options as a recipe's section, checked as it would be."""
    waves = any(pulse[key] is not None for key in ("amplitude_ml_min", "shape", "table"))
    idle = [key for key in ("period_s", "wall_young_kpa", "wall_thickness_mm")
            if pulse[key] is not None]  # fmt: skip
    if not waves and idle:
        raise UsageError(
            f"--{idle[0].replace('_', '-')} is for pulsatile flow; give --amplitude-ml-min, "
            "--shape or --waveform"
        )
    try:
        return FlowPart(**flow_section, pulse=PulsePart(**pulse) if waves else None)
    except ValidationError as exc:
        first = exc.errors()[0]
        name = ".".join(map(str, first["loc"])) or "pulsatile flow"
        raise UsageError(f"{name}: {first['msg'].removeprefix('Value error, ')}") from exc


def _steady(network: VesselNetwork, part: FlowPart, out: Path) -> tuple[dict[str, Any], list[Path]]:
    conditions = FlowConditions(
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        inlet_flow_ul_s=part.inlet_flow_ml_min * UL_S_PER_ML_MIN,
    )
    solution = solve_flow(network, conditions)
    summary: dict[str, Any] = flow_summary(network, solution, conditions)
    question_pressure(summary["pressure_drop_pa"])
    out.mkdir(parents=True, exist_ok=True)
    write_flow_csv(out / TABLE, network, solution)
    return summary, [out / TABLE]


def _run_case(path: Path, out: Path, as_json: bool) -> None:
    case = read_svzerod(path)
    found = run_svzerod(case)
    out.mkdir(parents=True, exist_ok=True)
    write_svzerod_csv(out / CASE, case, found)
    vessels = len(case.names)
    told = {
        "vessels": vessels,
        "cycles": len(found.change),
        "last_change": float(found.change[-1]),
        "periodic": found.periodic,
    }
    if not found.periodic:
        messages().print(
            f"the last cycle still changed by {found.change[-1]:.2g} of the largest value: the "
            "file's number_of_cardiac_cycles is too small for a periodic state", style="yellow"
        )  # fmt: skip
    _say(told, [out / CASE], as_json)


def _say(found: dict[str, Any], files: list[Path], as_json: bool) -> None:
    if as_json:
        print_json(found)
        return
    pulse, waves = found.pop("pulsatile", {}), found.pop("one_d", {})
    lines = [f"{key}: {value:.6g}" for key, value in found.items()]
    lines += [f"pulsatile {key}: {value:.6g}" for key, value in pulse.items()]
    lines += [f"1D {key}: {value:.6g}" for key, value in waves.items()]
    print_lines(*lines, *map(str, files))
