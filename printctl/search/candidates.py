"""Draw the candidates of a design search, as validated recipes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from printctl.errors import RecipeError
from printctl.pipeline.plates import Point
from printctl.recipe import Recipe, load_recipe
from printctl.recipe.override import overridden
from printctl.search.draw import drawn
from printctl.search.evaluate import Task, task_of
from printctl.search.model import SearchFile

WHOLE: Final = ("seed", "print_scale")
SECTIONS: Final = ("tissue", "vasculature", "flow")
WRITING: Final = ("needle", "layer_um", "line_um")
"""Keys of the toolpath that say what can be printed."""
_OTHERS: Final = (
    f"a search varies what its measures follow from: {', '.join(WHOLE)}, "
    f"{', '.join(f'{name}.…' for name in SECTIONS)}, "
    f"{', '.join(f'toolpath.{name}' for name in WRITING)}"
)


@dataclass(frozen=True)
class Candidate:
    """Candidate of a search: its values and recipe.

    Attributes
    ----------
    number : int
        From 1, in the order of drawing.
    values : mapping of str to value
        What is varied, and what it is here.
    recipe : Recipe
    task : Task
    """

    number: int
    values: Mapping[str, Any]
    recipe: Recipe
    task: Task

    @property
    def key(self) -> str:
        """Of its result."""
        return self.task.key

    @property
    def label(self) -> str:
        """For people: what each key is about, its value and unit."""
        return Point(self.values).label


@dataclass(frozen=True)
class CandidateSet:
    """All candidates, and what they are drawn from.

    Attributes
    ----------
    search : SearchFile
    folder : Path
        Of the recipe.
    candidates : sequence of Candidate
        None twice: where two come out as the same recipe, the first is kept.
    """

    search: SearchFile
    folder: Path
    candidates: Sequence[Candidate]


def draw_candidates(search: SearchFile, folder: Path) -> CandidateSet:
    """Draw all candidates of a search.

    Parameters
    ----------
    search : SearchFile
    folder : Path
        Of the search file.

    Raises
    ------
    RecipeError
        For a key that can't be varied, or a value that the recipe's schema refuses.
    """
    for key in search.vary:
        _check_key(key)
    path = (folder / search.recipe).resolve()
    base = load_recipe(path)
    if base.plate is not None:
        raise RecipeError(
            f"{path} prints on a plate, and a search looks for one part; remove plate from it"
        )
    by_key: dict[str, Candidate] = {}
    for number, values in enumerate(drawn(search), 1):
        one = _candidate(search, base, path.parent, number, values)
        by_key.setdefault(one.key, one)
    return CandidateSet(search, path.parent, list(by_key.values()))


def _check_key(key: str) -> None:
    section, _, inside = key.partition(".")
    if key in WHOLE or (section in SECTIONS and inside):
        return
    if section == "toolpath" and inside in WRITING:
        return
    raise RecipeError(f"vary: {key} isn't among what can be varied; {_OTHERS}")


def _candidate(
    search: SearchFile, base: Recipe, folder: Path, number: int, values: dict[str, Any]
) -> Candidate:
    origin = f"vary ({Point(values).label})"
    recipe = overridden(base, values, f"{search.name}_best", origin)
    task = task_of(recipe, folder, search.samples)
    if "wall_shear_outside_percent" in search.objectives and not recipe.flow.shear_band_dyn_cm2:
        raise RecipeError(
            f"{origin}: wall_shear_outside_percent needs a band; add flow.shear_band_dyn_cm2: "
            "[least, greatest] to the recipe"
        )
    return Candidate(number, values, recipe, task)
