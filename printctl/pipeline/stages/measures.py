"""Stage 3c: measure the network's supply of the tissue: distances to lumens, supply over demand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from design.files import write_text
from design.hemodynamics import solve_flow
from design.measures import MeasureOptions, measure_network, measures_dict
from printctl.pipeline.context import RunContext
from printctl.pipeline.stage import Stage
from printctl.progress import Report
from printctl.recipe.sections.growth import Growth
from printctl.run_folder.artefacts import NETWORK, SURFACE

MEASURES = "measures.json"


def options(context: RunContext) -> MeasureOptions:
    """Options of measuring this recipe's network."""
    part = context.recipe.vasculature
    exponent = part.murray_exponent if isinstance(part, Growth) else 3.0
    return MeasureOptions(
        seed=context.recipe.seed,
        printable_diameter_mm=context.printability().lumen_mm,
        murray_exponent=exponent,
    )


def depends(context: RunContext) -> Any:
    """What shapes the options, and the flow."""
    asked = options(context)
    return [
        context.recipe.flow.model_dump(mode="json"),
        context.outlets_digest,
        context.recipe.print_scale,
        [asked.seed, asked.printable_diameter_mm, asked.murray_exponent],
    ]


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Measure in the design's size, and keep every number; the report shows the main ones."""
    network = context.designed_network
    flow = solve_flow(network, context.designed_conditions).flow
    measures = measures_dict(measure_network(network, context.tissue, options(context), flow))
    write_text(context.folder / MEASURES, json.dumps(measures, indent=1, allow_nan=False) + "\n")
    return measures, [MEASURES]


def key_numbers(measures: dict[str, Any]) -> dict[str, Any]:
    """The few that stand beside the tissue in the report, for a grown tree or any other."""
    supply = measures["supply"]
    return {
        "way_to_a_lumen_mean_mm": supply["distance_mean_mm"],
        "way_to_a_lumen_p95_mm": supply["distance_p95_mm"],
        "way_to_a_lumen_max_mm": supply["distance_max_mm"],
        "within_200_um_of_a_lumen_percent": 100 * (1 - supply["beyond"]["200_um"]),
        "vessels_per_mm2": supply["vessels_per_mm2"],
        "supply_over_demand_p5": measures["territories"]["p5"] if measures["territories"] else None,
        "supply_over_demand_worst": measures["territories"]["worst"]
        if measures["territories"]
        else None,
        "branching_depth_max": measures["ways"]["depth_max"] if measures["ways"] else None,
    }


STAGE = Stage("measures", depends, (SURFACE, NETWORK), ("kernels", "design"), work)
