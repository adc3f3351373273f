"""Options of a dataclass in a command of typer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from printctl.cli.option_group import with_options_of


@dataclass(frozen=True)
class Paint:
    """Two options."""

    colour: Annotated[str, typer.Option("--colour", help="Of the paint.")] = "red"
    thick: Annotated[bool, typer.Option("--thick")] = False


def test_options_stand_where_the_parameter_does_and_come_as_one_value() -> None:
    app = typer.Typer()
    taken: list[tuple[str, Paint, int]] = []

    @app.command()
    @with_options_of(Paint, "paint")
    def draw(*, name: str, paint: Paint, times: int = 1) -> None:
        taken.append((name, paint, times))

    assert CliRunner().invoke(app, ["--name", "a"], catch_exceptions=False).exit_code == 2
    for words in (["a"], ["a", "--colour", "blue", "--thick", "--times", "2"]):
        done = CliRunner().invoke(app, words, catch_exceptions=False)
        assert done.exit_code == 0, done.output
    assert taken == [("a", Paint(), 1), ("a", Paint("blue", True), 2)]
    command = typer.main.get_command(app)
    assert [one.name for one in command.params][:4] == ["name", "colour", "thick", "times"]
