"""Schema of the search file: recipe, varied keys, goals and limits; reading it."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationError, model_validator

from printctl.errors import RecipeError
from printctl.recipe.load import read_mapping, refusal
from printctl.recipe.parts import Part, Seed
from printctl.search.quantities import QUANTITIES

MOST = 100_000
"""Candidates of one search."""
Draw = Literal["grid", "random", "sobol", "latin_hypercube"]
Goal = Literal["minimise", "maximise"]


class Range(Part):
    """Numbers between two ends, both of them included."""

    low: float = Field(alias="from")
    high: float = Field(alias="to")
    steps: Annotated[int, Field(ge=2, le=10_000)] | None = Field(
        default=None, description="Of a grid: how many values."
    )
    whole: bool = Field(default=False, description="Whole numbers only.")
    log: bool = Field(default=False, description="As many between 1 and 10 as between 10 and 100.")

    @model_validator(mode="after")
    def _ascends(self) -> Range:
        if not self.low < self.high:
            raise ValueError(f"from {self.low:g} isn't below to {self.high:g}; swap them")
        if self.log and self.low <= 0:
            raise ValueError(f"from {self.low:g}: log takes numbers above 0 only; leave log out")
        if self.whole and not (self.low.is_integer() and self.high.is_integer()):
            raise ValueError(
                f"whole: from {self.low:g} to {self.high:g} aren't whole numbers; make them so"
            )
        return self


def _kind(value: Any) -> str | None:
    if isinstance(value, dict | Range):
        return "range"
    return "values" if isinstance(value, list | tuple) else None


Values = Annotated[tuple[Any, ...], Field(min_length=1, max_length=MOST)]
Varied = Annotated[
    Annotated[Values, Tag("values")] | Annotated[Range, Tag("range")],
    Discriminator(
        _kind,
        custom_error_type="neither",
        custom_error_message="give a list of values, or a range {from: 1, to: 2}",
    ),
]


class Objective(Part):
    """What is wanted of one quantity: as little or as much as possible, a limit, or both."""

    goal: Goal | None = None
    weight: Annotated[float, Field(gt=0, le=1e6)] = Field(
        default=1.0, description="In the score, beside the other goals' weights."
    )
    at_least: float | None = None
    at_most: float | None = None

    @model_validator(mode="after")
    def _asks_for_something(self) -> Objective:
        if self.goal is None and self.at_least is None and self.at_most is None:
            raise ValueError("asks for nothing; give minimise, maximise, at_least or at_most")
        if self.goal is None and "weight" in self.model_fields_set:
            raise ValueError("weight without a goal has no meaning; add goal, or leave weight out")
        low, high = self.at_least, self.at_most
        if low is not None and high is not None and low > high:
            raise ValueError(f"at_least {low:g} is above at_most {high:g}; swap them")
        return self

    def beyond(self, value: float) -> float:
        """By how much a value breaks the limits, relative to the limit it breaks; 0 within."""
        for limit, over in ((self.at_least, -1.0), (self.at_most, 1.0)):
            if limit is not None and over * (value - limit) > 0:
                return over * (value - limit) / (abs(limit) or 1.0)
        return 0.0


def _short(value: Any) -> Any:
    """``minimise`` alone stands for ``{goal: minimise}``."""
    return {"goal": value} if isinstance(value, str) else value


class SearchFile(Part):
    """A whole search."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,55}$")]
    recipe: Annotated[str, Field(min_length=1, description="Path, relative to this file.")]
    draw: Draw = Field(default="grid", description="How candidates are drawn from what varies.")
    count: Annotated[int, Field(ge=1, le=MOST)] | None = Field(
        default=None, description="Candidates; of a grid its values say how many."
    )
    seed: Seed = Field(default=1, description="Of the drawing, not of the growth.")
    vary: Annotated[dict[str, Varied], Field(min_length=1, max_length=100)]
    objectives: Annotated[
        dict[str, Annotated[Objective, BeforeValidator(_short)]], Field(min_length=1)
    ]
    samples: Annotated[int, Field(ge=100, le=50_000_000)] = Field(
        default=200_000, description="Points in the tissue; the default is that of a run."
    )

    @property
    def goals(self) -> dict[str, Objective]:
        """The objectives that are minimised or maximised."""
        return {name: one for name, one in self.objectives.items() if one.goal is not None}

    @model_validator(mode="after")
    def _is_whole(self) -> SearchFile:
        self._check_count()
        self._check_objectives()
        return self

    def _check_count(self) -> None:
        grid = self.draw == "grid"
        if grid and self.count is not None:
            raise ValueError("count: a grid has as many as its values make; leave count out")
        if not grid and self.count is None:
            raise ValueError(f"draw: {self.draw} needs to know how many; add count")
        for key, one in self.vary.items():
            if isinstance(one, Range):
                if grid and one.steps is None:
                    raise ValueError(f"vary.{key}: a grid takes steps; add steps, or list values")
                if not grid and one.steps is not None:
                    raise ValueError(f"vary.{key}: steps are a grid's; leave them out")
            elif any(isinstance(v, float) and not isfinite(v) for v in one):
                raise ValueError(f"vary.{key} holds a number that isn't finite; remove it")

    def _check_objectives(self) -> None:
        unknown = [name for name in self.objectives if name not in QUANTITIES]
        if unknown:
            raise ValueError(
                f"objectives: {unknown[0]} isn't measured; choose from {', '.join(QUANTITIES)}"
            )
        if not self.goals:
            raise ValueError("objectives hold limits alone; minimise or maximise one of them")


_TAGS = ("values", "range")


def load_search(path: Path) -> SearchFile:
    """Read and validate a YAML search file.

    Raises
    ------
    RecipeError
        With the path of every wrong key, its value, the limit and the remedy.
    """
    data = read_mapping(path, "search file", "docs/search.md shows one")
    try:
        return SearchFile.model_validate(data)
    except ValidationError as exc:
        raise RecipeError(refusal(exc, str(path), _user_path)) from exc


def _user_path(loc: tuple[int | str, ...]) -> list[int | str]:
    """Without pydantic's word for the kind of ``vary.KEY``."""
    if len(loc) > 2 and loc[0] == "vary" and loc[2] in _TAGS:
        return [*loc[:2], *loc[3:]]
    return list(loc) or ["search file"]
