"""Options declared once: by a line in a signature, in a dataclass, or by a recipe's model."""

import inspect
from typing import Annotated

import pytest
import typer
from pydantic import BaseModel, Field
from typer.testing import CliRunner

from printctl.cli.declare import command, group
from printctl.settings import arg, of, opt, settings


class Care(BaseModel):
    limit_s: Annotated[float, Field(ge=10, le=60)] | None = Field(
        default=None, description="End without an answer for so long; stop_at_once is quicker."
    )
    stop_at_once: bool = Field(default=False, description="Stop, instead of pausing.")
    share: float = Field(default=0.5, ge=0, description="Of the whole.")


@settings
class Shape:
    width_mm: float = opt("Of the line.", 0.4, min=0.1)
    open_ends: bool | None = opt("Leave the ends open.")


@command
def draw(
    name: str = arg("Of the part."),
    shape: Shape = None,
    limit: float | None = of(Care, "limit_s", "--limit"),
    stop: bool = of(Care, "stop_at_once", "--stop"),
    share: float | None = of(Care, "share", default=None),
):
    """Draw a part."""
    print(name, shape.width_mm, shape.open_ends, limit, stop, share)


@pytest.fixture
def run():
    app = group(typer.Typer(), draw, again=draw)
    return lambda *words: CliRunner().invoke(app, ["draw", *words])


def test_options_of_a_dataclass_stand_where_it_does(run):
    names = list(inspect.signature(draw).parameters)
    assert names == ["name", "width_mm", "open_ends", "limit", "stop", "share"]
    done = run("wall", "--width-mm", "0.3", "--no-open-ends", "--stop")
    assert done.output.split() == ["wall", "0.3", "False", "None", "True", "None"]


def test_a_command_can_be_called_as_a_function(capsys):
    draw("wall", width_mm=0.2, share=0.1)
    assert capsys.readouterr().out.split() == ["wall", "0.2", "None", "None", "False", "0.1"]


@pytest.mark.parametrize("words", [["--limit", "9"], ["--limit", "61"], ["--width-mm", "0.05"], []])
def test_bounds_of_the_model_and_needed_arguments_hold(run, words):
    assert run(*(["wall", *words] if words else [])).exit_code == 2


def test_help_is_the_models_with_options_for_fields_and_the_unit():
    limit, share = of(Care, "limit_s", "--limit"), of(Care, "share", default=None)
    assert limit.text == "End without an answer for so long; --stop-at-once is quicker (s)."
    assert (limit.facts, limit.default) == ({"min": 10, "max": 60}, None)
    assert share.text == "Of the whole; else 0.5."
    assert of(Shape, "width_mm") == opt("Of the line.", 0.4, min=0.1)


def test_a_dataclass_of_settings_is_frozen_and_has_its_defaults():
    assert Shape() == Shape(0.4, None)
    with pytest.raises(AttributeError):
        Shape().width_mm = 1.0
