"""Options made from the fields of a recipe's section."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
import typer
from pydantic import Field, ValidationError
from typer.testing import CliRunner

from firmware_profiles.strict_model import StrictModel
from printctl.cli.option_group import with_options
from printctl.cli.section_options import (
    SectionOptions,
    parameters,
    section_values,
    wrong_option,
)
from printctl.errors import UsageError
from printctl.recipe.parts import FILE


class Bath(StrictModel):
    """A section within the section."""

    warmth_c: Annotated[float, Field(le=60)] | None = Field(
        default=None, description="Of the bath, where depth_mm doesn't say it."
    )
    stirred: bool = True


class Paint(StrictModel):
    """A section."""

    depth_mm: Annotated[float, Field(gt=0)] = Field(default=2.5, description="Of the paint.")
    colour: Literal["red", "blue"] = "red"
    table: str | None = Field(default=None, json_schema_extra=FILE)
    layers: tuple[float, ...] = ()
    bath: Bath | None = None


GROUPS = (
    SectionOptions(Paint, renamed={"table": "colours"}),
    SectionOptions(Bath, ("bath",), flag="Paint in a bath."),
)


def _typed(*words: str) -> tuple[dict[str, object], str]:
    """The section that the words stand for, or what is wrong with it."""
    app, seen = typer.Typer(), []

    @app.command()
    @with_options(parameters(GROUPS), "typed", dict)
    def draw(*, typed: dict[str, object]) -> None:
        seen.append(typed)

    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    if done.exit_code != 0:
        return {}, done.output
    try:
        section = section_values(GROUPS, seen[0])
        Paint.model_validate(section)
    except ValidationError as exc:
        return {}, str(wrong_option(exc, GROUPS, "paint"))
    except UsageError as exc:
        return {}, str(exc)
    return section, ""


def test_what_is_not_typed_is_left_to_the_section() -> None:
    assert _typed() == ({}, "")
    assert _typed("--bath") == ({"bath": {}}, "")


def test_fields_become_options_of_their_own_and_of_sections_within(tmp_path: Path) -> None:
    (tmp_path / "colours.csv").touch()
    words = ("--depth-mm", "4", "--colours", str(tmp_path / "colours.csv"), "--colour", "blue")
    section, wrong = _typed(*words, "--bath", "--no-stirred", "--warmth-c", "30")
    assert wrong == ""
    assert section == {
        "depth_mm": 4.0,
        "colour": "blue",
        "table": str((tmp_path / "colours.csv").resolve()),
        "bath": {"stirred": False, "warmth_c": 30.0},
    }


def test_what_one_word_can_not_say_is_no_option() -> None:
    assert [one.name for one in parameters(GROUPS)] == [
        "depth_mm", "colour", "colours", "bath", "warmth_c", "stirred",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--depth-mm", "0"), "--depth-mm: must be above 0 (is 0.0)"),
        (("--bath", "--warmth-c", "90"), "--warmth-c: must be at most 60 (is 90.0)"),
        (("--warmth-c", "30"), "--warmth-c is for --bath; add that, or leave it out"),
        (("--no-stirred",), "--no-stirred is for --bath"),
        (("--colours", "no.csv"), "--colours no.csv isn't there, or no file"),
        (("--colour", "green"), "'blue'"),
    ],
)
def test_mistakes_name_the_option(words: tuple[str, ...], said: str) -> None:
    assert said in _typed(*words)[1]


def test_help_is_the_fields_and_names_options() -> None:
    helped = {one.name: one.annotation.__metadata__[0] for one in parameters(GROUPS)}
    assert helped["warmth_c"].help == "Of the bath, where --depth-mm doesn't say it."
    assert helped["depth_mm"].show_default == "2.5"
    assert helped["bath"].help == "Paint in a bath."
