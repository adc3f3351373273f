"""`printctl flow`: blood flow in any network, by 0D, 1D or 3D solver."""

from __future__ import annotations

from pathlib import Path

import typer

from printctl.cli import flow_options as options
from printctl.cli.flow_case import read_case, run_case
from printctl.cli.flow_openbf import read_openbf, run_openbf_case
from printctl.cli.flow_output import FlowOutput
from printctl.cli.network_options import SourceArg, UnitOption
from printctl.cli.options import JsonFlag, print_json, print_lines


def flow(
    context: typer.Context,
    network: SourceArg,
    unit: UnitOption = None,
    out: options.OutOption = Path("flow"),
    inlet_flow_ml_min: options.InletFlowOption = None,
    inlet_pressure_mmhg: options.InletPressureOption = None,
    outlet_pressure_mmhg: options.OutletPressureOption = 0.0,
    outlet_resistance_mmhg_min_ml: options.OutletResistanceOption = None,
    outlet_proximal_mmhg_min_ml: options.OutletProximalOption = None,
    outlet_compliance_ml_mmhg: options.OutletComplianceOption = None,
    outlets: options.OutletsOption = None,
    viscosity_mpa_s: options.ViscosityOption = None,
    density_g_cm3: options.DensityOption = None,
    fluid: options.FluidOption = None,
    junction_k: options.JunctionOption = None,
    stenosis: options.StenosisOption = None,
    shear_band_dyn_cm2: options.ShearBandOption = None,
    amplitude_ml_min: options.AmplitudeOption = None,
    amplitude_mmhg: options.AmplitudePressureOption = None,
    shape: options.ShapeOption = None,
    waveform: options.WaveformOption = None,
    period_s: options.PeriodOption = None,
    wall_young_kpa: options.WallYoungOption = None,
    wall_thickness_mm: options.WallThicknessOption = None,
    profile: options.ProfileOption = "womersley",
    steps: options.StepsOption = 100,
    svzerod: options.SvzerodOption = None,
    one_d: options.OneDFlag = False,
    cell_mm: options.CellOption = None,
    wall_viscosity_pa_s: options.WallViscosityOption = None,
    svoned: options.SvonedOption = None,
    three_d: options.ThreeDFlag = False,
    edge_ratio: options.EdgeOption = None,
    order: options.OrderOption = None,
    check: options.CheckFlag = False,
    fillet_ratio: options.FilletOption = None,
    compare: options.CompareFlag = False,
    along_vessel: options.AlongOption = None,
    as_printed: options.AsPrintedFlag = False,
    scanned: options.ScannedFlag = False,
    ranks: options.RanksOption = None,
    ranks_python: options.PythonOption = None,
    slurm: options.SlurmOption = None,
    slurm_set: options.SlurmSettingsOption = None,
    svmultiphysics: options.SvmultiphysicsOption = None,
    match_split: options.MatchFlag = False,
    want: options.WantOption = None,
    match_percent: options.PercentOption = None,
    least_lumen_mm: options.LeastOption = None,
    results: options.ResultsOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Solve the flow in a network: lumped; as waves (--one-d); in the lumens' space (--three-d).

    Steady, and in pulses, too, where a wave is given. --as-printed takes a registered run. An
    input file of svZeroDSolver (.json) is stepped through its cycles instead, one of openBF
    (.yaml) is solved as waves.
    """
    case = read_case(network)
    if case is not None:
        _say(run_case(context, case, network, out), as_json)
        return
    openbf = read_openbf(network)
    if openbf is not None:
        _say(run_openbf_case(context, openbf, network, out), as_json)
        return
    # Loaded late: a case of svZeroDSolver needs no network, mesh or figure.
    from printctl.cli.flow_network import run_network

    _say(run_network(context, network, out), as_json)


def _say(output: FlowOutput, as_json: bool) -> None:
    if as_json:
        print_json(output.summary)
        return
    print_lines(*_lines("", output.summary), *map(str, output.files))


def _lines(before: str, values: dict[str, object]) -> list[str]:
    """A line a number, the names of groups before theirs."""
    lines: list[str] = []
    for key, value in values.items():
        if isinstance(value, dict):
            lines += _lines(f"{before}{key} ", value)
        elif isinstance(value, int | float):
            lines.append(f"{before}{key}: {value:.6g}")
        else:
            lines.append(f"{before}{key}: {value}")
    return lines
