"""Typer options of `printctl flow`: boundary conditions, fluid, 0D, 1D and 3D settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

OutOption = Annotated[
    Path, typer.Option("--out", help="Folder for the tables; made where it isn't.")
]
InletFlowOption = Annotated[
    float | None,
    typer.Option("--inlet-flow-ml-min", min=1e-9, help="Mean, of all inlets; 0.25 by default."),
]
InletPressureOption = Annotated[
    float | None, typer.Option("--inlet-pressure-mmhg", help="Mean; in place of a flow.")
]
OutletPressureOption = Annotated[
    float, typer.Option("--outlet-pressure-mmhg", help="At, or behind, every outlet.")
]
OutletResistanceOption = Annotated[
    float | None,
    typer.Option("--outlet-resistance-mmhg-min-ml", help="Behind every outlet."),
]
OutletProximalOption = Annotated[
    float | None,
    typer.Option("--outlet-proximal-mmhg-min-ml", help="Makes it a Windkessel, with the next."),
]
OutletComplianceOption = Annotated[
    float | None, typer.Option("--outlet-compliance-ml-mmhg", help="Of the Windkessel.")
]
OutletsOption = Annotated[
    Path | None,
    typer.Option("--outlets", help="CSV with a row for each outlet (docs/flow.md)."),
]
ViscosityOption = Annotated[
    float | None, typer.Option("--viscosity-mpa-s", min=1e-6, help="Newtonian; 1 by default.")
]
DensityOption = Annotated[
    float | None,
    typer.Option("--density-g-cm3", help="Of pulses, 3D, losses, Reynolds numbers, g/cm³; 1.06."),
]
FluidOption = Annotated[
    Path | None,
    typer.Option("--fluid", help="YAML with a recipe's flow.viscosity: model: carreau and so on."),
]
JunctionOption = Annotated[
    float | None,
    typer.Option("--junction-k", help="Loss K ϱ u²/2 where a vessel leaves a bifurcation."),
]
StenosisOption = Annotated[
    list[str] | None,
    typer.Option(
        "--stenosis",
        metavar="VESSEL,SHARE,MM",
        help="Vessel, diameter left (0.1 to 1), length; may be given again.",
    ),
]
ShearBandOption = Annotated[
    str | None,
    typer.Option("--shear-band-dyn-cm2", metavar="LOW,HIGH", help="Wall shear that is wanted."),
]
AmplitudePressureOption = Annotated[
    float | None,
    typer.Option("--amplitude-mmhg", help="Of a sine about the inlet's pressure."),
]
AmplitudeOption = Annotated[
    float | None, typer.Option("--amplitude-ml-min", help="Of a sine about the mean.")
]
ShapeOption = Annotated[
    str | None, typer.Option("--shape", help="ejection or roller_pump, scaled to the mean.")
]
WaveformOption = Annotated[
    Path | None, typer.Option("--waveform", help="CSV with time_s, flow_ml_min or pressure_mmhg.")
]
PeriodOption = Annotated[float | None, typer.Option("--period-s", help="Of a cycle.")]
WallYoungOption = Annotated[
    float | None, typer.Option("--wall-young-kpa", help="Of the gel around; else rigid.")
]
WallThicknessOption = Annotated[
    float | None, typer.Option("--wall-thickness-mm", help="Of free tubes, not in gel.")
]
ProfileOption = Annotated[
    str, typer.Option("--profile", help="Of the pulse: womersley or poiseuille.")
]
StepsOption = Annotated[int, typer.Option("--steps", help="Of a cycle.")]
SvzerodOption = Annotated[
    Path | None,
    typer.Option("--svzerod", help="Write the pulsatile problem for svZeroDSolver, too."),
]
OneDFlag = Annotated[
    bool, typer.Option("--one-d", help="Follow the pulse's waves along the vessels, too.")
]
CellOption = Annotated[float | None, typer.Option("--cell-mm", help="Of 1D flow.")]
WallViscosityOption = Annotated[
    float | None, typer.Option("--wall-viscosity-pa-s", help="Kelvin-Voigt walls in 1D flow.")
]
SvonedOption = Annotated[
    Path | None,
    typer.Option("--svoned", help="Write the pulsatile problem for svOneDSolver, too."),
]
ThreeDFlag = Annotated[
    bool, typer.Option("--three-d", help="Resolve the flow in the lumens' space, too.")
]
EdgeOption = Annotated[
    float | None, typer.Option("--edge-ratio", help="Of 3D: element's edge over the radius; 0.7.")
]
OrderOption = Annotated[
    int | None, typer.Option("--order", help="Of 3D elements: 2, or 3 (more exact, slower).")
]
CheckFlag = Annotated[
    bool, typer.Option("--check", help="Solve 3D once more, of the other order: error estimate.")
]
FilletOption = Annotated[
    float | None,
    typer.Option("--fillet-ratio", help="Of 3D: fillet over the thinnest vessel's radius."),
]
AsPrintedFlag = Annotated[
    bool,
    typer.Option(
        "--as-printed", help="Of a run: as designed against the lumens that registration found."
    ),
]
ScannedFlag = Annotated[
    bool, typer.Option("--scanned", help="3D as printed in the scan's own surface.")
]
CompareFlag = Annotated[
    bool, typer.Option("--compare", help="Fidelities side by side, each against the ideal.")
]
AlongOption = Annotated[
    int | None, typer.Option("--along-vessel", help="Compare at ten places of it; the longest.")
]
RanksOption = Annotated[
    int | None, typer.Option("--ranks", help="Solve 3D on so many MPI processes, by FEniCSx.")
]
SlurmOption = Annotated[
    Path | None, typer.Option("--slurm", help="Write a batch script that does it on a cluster.")
]
SlurmSettingsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--slurm-set",
        metavar="NAME=VALUE",
        help="Of --slurm: nodes, ntasks, time, mem, partition, account, python, setup.",
    ),
]
PythonOption = Annotated[
    Path | None, typer.Option("--ranks-python", help="Interpreter with dolfinx, for --ranks.")
]
SvmultiphysicsOption = Annotated[
    Path | None,
    typer.Option("--svmultiphysics", help="Write the pulsatile 3D case for svMultiPhysics here."),
]
MatchFlag = Annotated[
    bool, typer.Option("--match-split", help="Adjust radii until 3D divides as 0D, or --want.")
]
WantOption = Annotated[
    list[str] | None,
    typer.Option("--want", metavar="NODE,ML_MIN", help="Flow wanted at an outlet; again for more."),
]
PercentOption = Annotated[
    float | None,
    typer.Option("--match-percent", help="Largest deviation, of the inlet's flow; 0.5."),
]
LeastOption = Annotated[
    float | None,
    typer.Option("--least-lumen-mm", min=0.0, help="Smallest diameter that can be printed."),
]
ResultsOption = Annotated[
    Literal["csv", "npz"] | None,
    typer.Option("--results", help="Tables as csv, or as arrays of one npz (NumPy, fast)."),
]
