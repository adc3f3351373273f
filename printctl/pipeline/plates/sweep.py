"""Expand a plate's parameter sweep into variants, and make each well's recipe and ink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Final

from pydantic import ValidationError

from firmware_profiles import Ink
from firmware_profiles.errors import wording
from printctl.errors import RecipeError
from printctl.recipe import Recipe
from printctl.recipe.override import overridden
from registration.report.wording import label_and_unit

DESIGN: Final = ("tissue", "vasculature", "solid", "toolpath")
INK: Final = ("flow_factor", "retract_ul", "plunger_ul_s", "dwell_s")
"""Keys of the ink's profile that a job's lines follow from."""
_ONE_JOB: Final = (
    "toolpath.method",
    "toolpath.needle",
    "toolpath.compensate_lag",
    "toolpath.prime",
)
_OTHERS: Final = (
    "a sweep varies what is printed: tissue.…, vasculature.…, solid.…, toolpath.…, seed, "
    f"print_scale, and of the ink's profile {', '.join(f'ink.{key}' for key in INK)}"
)


@dataclass(frozen=True)
class Point:
    """One variant.

    Attributes
    ----------
    values : mapping of str to value
        Swept key to what it is here; empty without a sweep.
    """

    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """For people, in one line: what each key is about, its value and unit."""
        return ", ".join(_words(key, value) for key, value in self.values.items())

    @property
    def ink(self) -> dict[str, Any]:
        """What it changes of the ink's profile."""
        return {
            key.partition(".")[2]: value
            for key, value in self.values.items()
            if key.startswith("ink.")
        }


def _words(key: str, value: Any) -> str:
    name, unit = label_and_unit(key.rpartition(".")[2])
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{name[:1].lower()}{name[1:]} {text} {unit}".rstrip()


def points(sweep: Mapping[str, Sequence[Any]], combine: str) -> list[Point]:
    """All variants, the last key's values varying fastest; one without a sweep.

    Raises
    ------
    RecipeError
        For a key that no sweep can vary.
    """
    for key in sweep:
        _check_key(key)
    rows = product(*sweep.values()) if combine == "grid" else zip(*sweep.values(), strict=True)
    if not sweep:
        return [Point()]
    variants = [Point(dict(zip(sweep, row, strict=True))) for row in rows]
    twice = next((point for point in variants if variants.count(point) > 1), None)
    if twice:
        raise RecipeError(
            f"plate.sweep holds {twice.label} more than once; say it once, and copies for more"
        )
    return variants


def _check_key(key: str) -> None:
    section, _, inside = key.partition(".")
    if any(f"{key}.".startswith(f"{one}.") for one in _ONE_JOB):
        raise RecipeError(f"plate.sweep: {key} can't differ from well to well within one job")
    if section == "ink" and inside not in INK:
        raise RecipeError(f"plate.sweep: {key} isn't among what can be varied; {_OTHERS}")
    if key in ("seed", "print_scale") or section == "ink" or (section in DESIGN and inside):
        return
    raise RecipeError(f"plate.sweep: {key} isn't among what can be varied; {_OTHERS}")


def varied_recipe(recipe: Recipe, point: Point, well: str) -> Recipe:
    """The recipe of one well alone, without its plate, held against the recipe's own schema.

    Raises
    ------
    RecipeError
        For a key that the recipe hasn't, or a value that it refuses.
    """
    design = {key: value for key, value in point.values.items() if not key.startswith("ink.")}
    origin = f"plate.sweep ({point.label})" if point.values else "plate"
    return overridden(recipe, design, f"{recipe.name[:56]}_{well}", origin)


def varied_ink(ink: Ink, changes: Mapping[str, Any]) -> Ink:
    """The ink's profile with a variant's values.

    Raises
    ------
    RecipeError
        For a value out of its bounds.
    """
    if not changes:
        return ink
    try:
        return Ink.model_validate(ink.model_dump(exclude_unset=True) | dict(changes))
    except ValidationError as exc:
        wrong = exc.errors()[0]
        key = ".".join(str(part) for part in wrong["loc"])
        raise RecipeError(
            f"plate.sweep: ink.{key}: {wording(wrong)} (is {wrong['input']!r})"
        ) from exc
