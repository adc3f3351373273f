"""The recipe: all that a run depends on, in one file with a schema version."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from printctl.recipe.making import (
    Fresh,
    PrinterPart,
    RegistrationPart,
    ScanPart,
    SimulatedScan,
    ToolpathPart,
)
from printctl.recipe.parts import Block, FlowPart, NamedNetwork, NetworkPart, Part, Seed, TissuePart


class Recipe(Part):
    """A whole run, from tissue to registration report."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    seed: Seed = 1
    tissue: TissuePart
    vasculature: NetworkPart
    flow: FlowPart = FlowPart()
    toolpath: ToolpathPart = Fresh(method="fresh")
    printer: PrinterPart = PrinterPart()
    scan: ScanPart = SimulatedScan(simulated="oct")
    registration: RegistrationPart = RegistrationPart()

    @model_validator(mode="after")
    def _parts_fit(self) -> Recipe:
        if isinstance(self.vasculature, NamedNetwork) and not isinstance(self.tissue, Block):
            raise ValueError(
                "vasculature.design planar_four_vessel is made for a block; "
                "give tissue: {shape: block, size_mm: [16, 8, 3]}"
            )
        if isinstance(self.scan, SimulatedScan) and self.printer.port != "simulated":
            raise ValueError(
                f"scan.simulated {self.scan.simulated} needs what the simulated printer deposited, "
                f"but printer.port is {self.printer.port}; give scan.file, or port: simulated"
            )
        return self
