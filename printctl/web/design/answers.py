"""Request and response types of the Design page's REST routes."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from printctl.web.design.checking import CheckedRecipe
from printctl.web.design.recipes import RecipeText
from printctl.web.design.run_processes import RunProgress
from printctl.web.design.run_views.compare import Difference


class Refusal(BaseModel):
    """Why something isn't done."""

    error: str
    message: str


REFUSALS: dict[int | str, dict[str, Any]] = {
    404: {"model": Refusal, "description": "There is no such thing."},
    409: {"model": Refusal, "description": "Not while things stand as they do."},
    422: {"model": Refusal, "description": "What was sent can't be taken."},
}


class ProblemAnswer(BaseModel):
    """One thing that is wrong with a recipe."""

    path: list[str | int] = Field(description="Keys to the field; empty for the whole.")
    message: str


class RecipeRow(BaseModel):
    """A recipe of the workspace."""

    name: str
    modified: float = Field(description="Seconds since 1970.")
    problems: int


class RecipeAnswer(BaseModel):
    """A recipe's text and what is wrong with it."""

    name: str
    text: str
    version: str = Field(description="To be sent back with a changed text.")
    problems: list[ProblemAnswer]

    @classmethod
    def of(cls, text: RecipeText, checked: CheckedRecipe) -> RecipeAnswer:
        """Of a recipe."""
        return cls(name=text.name, text=text.text, version=text.version, problems=problems(checked))


def problems(checked: CheckedRecipe) -> list[ProblemAnswer]:
    """Serialise validation problems for the REST API."""
    return [ProblemAnswer(path=list(p.path), message=p.message) for p in checked.problems]


class NewRecipe(BaseModel):
    """What a new recipe begins from."""

    name: str = Field(max_length=64)
    source: str = Field(default="starter", max_length=64, description="starter, or an example.")


class RenameRequest(BaseModel):
    """Another name."""

    name: str = Field(max_length=64)


class RecipeTextRequest(BaseModel):
    """A recipe's text."""

    text: str = Field(max_length=256_000)


class ChangedText(RecipeTextRequest):
    """A changed text, and the version that was changed."""

    version: str | None = Field(default=None, description="Of the text before; none for a new one.")


class Validation(BaseModel):
    """What is wrong with a text."""

    valid: bool
    problems: list[ProblemAnswer]


class RunAnswer(BaseModel):
    """A run of the workspace."""

    name: str
    modified: float = Field(description="Seconds since 1970.")
    state: str
    until: str = Field(description="The last stage that was asked for.")
    has_job: bool
    has_report: bool


class StageAnswer(BaseModel):
    """A stage of a run."""

    name: str
    state: str
    fraction: float
    note: str
    remarks: list[str]


class ProgressAnswer(BaseModel):
    """How far a run is."""

    name: str
    state: str
    until: str
    fraction: float
    message: str
    begun: float = Field(description="Seconds since 1970; 0 when not known.")
    stages: list[StageAnswer]

    @classmethod
    def of(cls, run: RunProgress) -> ProgressAnswer:
        """Of a run."""
        return cls(
            name=run.name,
            state=run.state,
            until=run.until,
            fraction=run.fraction,
            message=run.message,
            begun=run.begun,
            stages=[StageAnswer(**{**vars(s), "remarks": list(s.remarks)}) for s in run.stages],
        )


class MakeRequest(BaseModel):
    """How far a design is to be made."""

    until: str = Field(default="lumens", max_length=40, description="Last stage; none that prints.")


class ComparisonAnswer(BaseModel):
    """Two runs beside each other."""

    recipe: list[Difference]
    figures: list[Difference]
