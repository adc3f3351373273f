"""Typer options of `printctl register`: design, output folder, datums, tolerances, record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from design.units import LengthUnit
from printctl.cli.options import folder_to_write
from registration.measuring.judging.tolerance import DecisionRule

ModelOption = Annotated[
    Path, typer.Option("--model", help="A run folder, or the design's STL.", show_default=False)
]
OutOption = Annotated[
    Path,
    typer.Option(
        "--out", callback=folder_to_write, help="Folder for the files.", show_default=False
    ),
]
NetworkOption = Annotated[
    Path | None,
    typer.Option(
        "--network",
        help="network.csv in mm; else the one beside the model, or the lumens found in an STL.",
    ),
]
LumensFlag = Annotated[
    bool | None,
    typer.Option(
        "--lumens/--whole",
        help="With a run folder: only its lumens were scanned, or the whole part. If not given, "
        "the lumens of an embedded print, the whole part of FRESH layers. With an STL and no "
        "network: the STL is the lumens.",
        show_default=False,
    ),
]
ModelUnit = Annotated[LengthUnit, typer.Option("--unit", help="Unit of an STL model.")]
PrintOption = Annotated[
    Path | None,
    typer.Option(
        "--print", help="The print that was scanned: its folder or file; else the run's own."
    ),
]
RecordOption = Annotated[
    Path | None,
    typer.Option(
        "--record",
        help="YAML file of the measurement record: instrument, certificate, operator, "
        "temperature (docs/registration.md).",
    ),
]
ToleranceOption = Annotated[
    Path | None,
    typer.Option(
        "--tolerance", help="YAML file of limits by vessel and feature (docs/registration.md)."
    ),
]
DatumsOption = Annotated[
    str | None,
    typer.Option(
        "--datums",
        help="Datum features, primary first, like 'face -z, face -x, axis 3'; also 'inlet 0', "
        "'outlet 3', 'ports'; else best fit.",
    ),
]
RmsOption = Annotated[
    float | None,
    typer.Option(
        "--tolerance-um",
        help="RMS deviation of the scaled fit above which the print doesn't pass; else 100.",
        min=0.1,
    ),
]
RuleOption = Annotated[
    DecisionRule | None,
    typer.Option(
        "--decision-rule",
        help="How limits count uncertainty: conformance (probability that the vessel conforms), "
        "guarded (ISO 14253-1), shared_risk (the value alone); else conformance.",
    ),
]
ConformanceOption = Annotated[
    float | None,
    typer.Option(
        "--conformance-percent",
        help="Probability from which on a vessel passes by the rule conformance; else 95.",
    ),
]
DiameterOption = Annotated[
    str | None,
    typer.Option(
        "--diameter-tolerance-percent",
        help="Error of any section's diameter beyond which it doesn't, like 10 or +10/-5; else 10.",
    ),
]
