"""Wording of schema validation errors."""

from typing import Literal

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from firmware_profiles.errors import wording
from printctl.errors import RecipeError
from printctl.recipe.load import parse_recipe
from printctl.web.api import answer_errors


class Part(BaseModel):
    """Everything that a request may have."""

    model_config = ConfigDict(extra="forbid")

    count: int = Field(default=1, ge=1, le=10)
    gap_mm: FiniteFloat = Field(default=1.0, gt=0, lt=5)
    name: str = Field(default="one", min_length=2, max_length=4, pattern="^[a-z]+$")
    kind: Literal["a", "b"] = "a"
    on: bool = True
    several: list[int] = Field(default=[1], min_length=1, max_length=2)


class Whole(BaseModel):
    """A part inside."""

    part: Part = Part()


WRONG = [
    ({"count": "x"}, "must be a whole number"),
    ({"count": 1.5}, "must be a whole number"),
    ({"count": 0}, "must be at least 1"),
    ({"count": 11}, "must be at most 10"),
    ({"gap_mm": "wide"}, "must be a number"),
    ({"gap_mm": 0}, "must be above 0"),
    ({"gap_mm": 5}, "must be below 5"),
    ({"gap_mm": float("nan")}, "must be a finite number"),
    ({"name": 1}, "must be text"),
    ({"name": "a"}, "must have at least 2 characters"),
    ({"name": "abcde"}, "must have at most 4 characters"),
    ({"name": "AB"}, "must be written as ^[a-z]+$"),
    ({"kind": "c"}, "must be one of 'a' or 'b'"),
    ({"on": "perhaps"}, "must be true or false"),
    ({"several": 1}, "must be a list"),
    ({"several": []}, "must have at least 1 entries"),
    ({"several": [1, 2, 3]}, "must have at most 2 entries"),
    ({"colour": 1}, "is no key here"),
]


@pytest.mark.parametrize(("data", "words"), WRONG)
def test_each_wrong_value_is_told_in_our_words(data, words):
    with pytest.raises(ValidationError) as caught:
        Part.model_validate(data)
    assert [wording(dict(one)) for one in caught.value.errors()] == [words]


def test_what_must_be_keys_is_told_so():
    with pytest.raises(ValidationError) as caught:
        Whole.model_validate({"part": 3})
    assert wording(dict(caught.value.errors()[0])) == "must be keys with values"


def answer(**data) -> tuple[int, str]:
    app = FastAPI()
    answer_errors(app)

    @app.post("/part")
    def take(part: Part) -> int:
        return part.count

    said = TestClient(app).post("/part", json=data)
    return said.status_code, said.json()["message"]


def test_a_request_is_answered_by_place_what_it_must_be_and_what_it_is():
    assert answer(count="x") == (422, "body.count must be a whole number (is 'x')")
    assert answer(count=0) == (422, "body.count must be at least 1 (is 0)")


def test_a_recipe_is_refused_in_our_words():
    with pytest.raises(RecipeError) as caught:
        parse_recipe({"name": 3}, "a.yaml")
    assert "Input should" not in str(caught.value)
    assert "name: must be text (is 3)" in str(caught.value)
