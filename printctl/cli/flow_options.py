"""Options of `printctl flow`; a recipe's section ``flow`` says the same under the same names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

OutOption = Annotated[
    Path, typer.Option("--out", help="Folder for the tables; made where it isn't.")
]
InletFlowOption = Annotated[
    float, typer.Option("--inlet-flow-ml-min", min=1e-9, help="Mean, of all inlets.")
]
ViscosityOption = Annotated[float, typer.Option("--viscosity-mpa-s", min=1e-6)]
AmplitudeOption = Annotated[
    float | None, typer.Option("--amplitude-ml-min", help="Of a sine about the mean.")
]
ShapeOption = Annotated[
    str | None, typer.Option("--shape", help="ejection or roller_pump, scaled to the mean.")
]
WaveformOption = Annotated[
    Path | None, typer.Option("--waveform", help="CSV with time_s, flow_ml_min.")
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
