"""Grow and measure one search candidate, in a worker process.

The stages' own functions are used, as far as the measures; the network goes through
``network.csv`` in a scratch folder as in a run, so that a candidate's numbers are those of
``printctl run`` to the last bit.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from rich.console import Console

from design.errors import DesignError
from design.hemodynamics import (
    band_summary,
    flow_summary,
    question_pressure,
    scaled_network,
    solve_flow,
)
from design.measures import measure_network, measures_dict
from design.network_files.csv_format import write_network_csv
from design.tissue import Tissue
from firmware_profiles import ProfileError
from printctl.analysis.flow.solve import shear_band
from printctl.errors import PrintctlError
from printctl.pipeline.context import RunContext
from printctl.pipeline.facts import input_digests
from printctl.pipeline.stages import measures
from printctl.pipeline.stages.design import vasculature
from printctl.pipeline.tissue_source import make_tissue
from printctl.progress import StageBars
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.load import recipe_data
from printctl.recipe.sections.tissue import TissuePart
from printctl.run_folder.artefacts import NETWORK
from printctl.run_folder.manifest import Manifest, digest_json
from printctl.search.quantities import QUANTITIES, GrownCandidate, numbers_of
from printctl.sources import source_digest

CODE = ("design", "firmware_profiles", "kernels")
"""Packages whose sources a candidate's numbers rest on."""
LATER = ("name", "solid", "scan", "registration")
"""What of a recipe no number here follows from."""
NUMBERS = 1
"""Raised when a quantity comes to mean something else: results from before are then made anew."""


class WorkerError(PrintctlError):
    """A worker that can't be trusted with a candidate: other files, or another printctl."""


@dataclass(frozen=True)
class Task:
    """One candidate, as it goes to a worker.

    Attributes
    ----------
    key : str
        Hash of all that the numbers follow from, 16 hex digits.
    recipe : mapping
        What the user said, JSON-able.
    folder : str
        The recipe's, to which its files' names are relative; the same on every worker.
    files : mapping of str to str
        SHA-256 of each of them.
    limits_mm : tuple
        What can be printed, by profiles that may be the user's own; empty where they can't be
        combined.
    samples : int
        Points in the tissue.
    code : str
        `code_digest` of who asks.
    """

    key: str
    recipe: Mapping[str, Any]
    folder: str
    files: Mapping[str, str]
    limits_mm: tuple[float | None, ...]
    samples: int
    code: str


def code_digest() -> str:
    """Of the sources that a candidate's numbers rest on."""
    return source_digest(CODE)


def task_of(recipe: Recipe, folder: Path, samples: int) -> Task:
    """The task of growing and measuring one recipe.

    Raises
    ------
    ProfileError
        When it names a profile that isn't there.
    """
    context = _context(recipe, folder, folder)
    files, limits, code = _files(context), _limits(context), code_digest()
    # With all defaults: one that changes makes another candidate.
    whole = recipe.model_dump(mode="json", by_alias=True, exclude=set(LATER))
    key = digest_json([NUMBERS, list(QUANTITIES), whole, files, limits, samples, code])
    return Task(key[:16], recipe_data(recipe), str(folder), files, limits, samples, code)


def _files(context: RunContext) -> dict[str, str]:
    """Digests of all the user's files, those of the flow among them."""
    flow = context.recipe.flow
    named = [flow.outlets, flow.pulse and flow.pulse.table]
    return input_digests(context) | context.digests([name for name in named if name])


def _limits(context: RunContext) -> tuple[float | None, ...]:
    try:
        limits = context.printability()
    except DesignError:  # `evaluate` tells it of this candidate
        return ()
    return limits.lumen_mm, limits.widest_mm, limits.wall_mm


def evaluate(task: Task) -> dict[str, Any]:
    """Grow and measure one candidate.

    Returns
    -------
    dict
        ``{"numbers": {name: number or None}}``, or ``{"refused": message}`` where it can't be
        grown, or can't be solved. The same on every machine that has the same printctl.

    Raises
    ------
    WorkerError
        When the recipe's files, its profiles or the product aren't here as they are where the
        search runs.
    """
    if task.code != code_digest():
        raise WorkerError(
            "the worker has another printctl than the search: its sources differ; install the "
            "same version on every worker"
        )
    try:
        recipe = parse_recipe(dict(task.recipe), "candidate")
        with tempfile.TemporaryDirectory(prefix="printctl-search-") as scratch:
            context = _context(recipe, Path(task.folder), Path(scratch))
            _check_files(context, task)
            return {"numbers": numbers_of(_grown(context, task))}
    except WorkerError:
        raise
    except (DesignError, ProfileError, PrintctlError) as exc:
        return {"refused": str(exc)}


def _check_files(context: RunContext, task: Task) -> None:
    digests = _files(context)
    wrong = [name for name, digest in task.files.items() if digests.get(name) != digest]
    if wrong:
        raise WorkerError(
            f"{context.recipe_folder / wrong[0]} isn't there on the worker as it is where the "
            "search runs; put the recipe into a folder that all of them share"
        )
    if _limits(context) != tuple(task.limits_mm):
        raise WorkerError(
            "a profile that the recipe names is another on the worker than where the search runs; "
            "name it by a path that all of them share"
        )


def _grown(context: RunContext, task: Task) -> GrownCandidate:
    recipe = context.recipe
    context.tissue = _tissue(recipe.tissue, task.folder, tuple(sorted(task.files.items())))
    made, _ = vasculature.make_network(context)
    write_network_csv(context.folder / NETWORK, scaled_network(made, recipe.print_scale))
    driven = context.conditions
    solution = solve_flow(context.network, driven)
    flow = flow_summary(context.network, solution, driven)
    question_pressure(flow["pressure_drop_pa"])
    designed = context.designed_network
    options = replace(measures.options(context), samples=task.samples)
    through = solve_flow(designed, context.designed_conditions).flow
    measured = measures_dict(measure_network(designed, context.tissue, options, through))
    band = shear_band(recipe.flow)
    shares = None if band is None else band_summary(context.network, solution, band)
    return GrownCandidate(designed, measured, flow, context.printability(), shares)


@lru_cache(maxsize=4)
def _tissue(part: TissuePart, folder: str, files: tuple[tuple[str, str], ...]) -> Tissue:
    """A tissue that most candidates share; ``files`` tell when one of them has changed."""
    return make_tissue(part, Path(folder))


def _context(recipe: Recipe, recipe_folder: Path, folder: Path) -> RunContext:
    quiet = StageBars(Console(file=io.StringIO()))
    return RunContext(recipe, recipe_folder, folder, Manifest(folder), quiet)
