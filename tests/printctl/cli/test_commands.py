"""Subcommand discovery: only the requested subcommand is imported."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from printctl.cli.commands import COMMANDS, LazyGroup, summary
from printctl.cli.main import app

LOADED = """
import sys
from printctl.cli.main import app
app(["pause", "--help"], standalone_mode=False)
print("registration" in sys.modules)
"""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_can_be_asked_for_help(name):
    result = CliRunner().invoke(app, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert f" {name} " in result.output


@pytest.mark.parametrize("name", ["flow", "oxygen", "register"])
def test_names_of_options_are_whole_in_a_terminal_of_80_columns(name: str) -> None:
    """--outlet-resistance-mmhg-min… was what the help told."""
    narrow = {"COLUMNS": "80", "TERMINAL_WIDTH": "80"}
    said = CliRunner().invoke(app, [name, "--help"], env=narrow).output
    for param in LazyGroup().get_command(None, name).params:
        names = [*param.opts, *param.secondary_opts]
        assert all(name in said for name in names if name.startswith("-"))
    assert max(map(len, said.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_a_summary_is_what_the_command_says_of_itself(name: str) -> None:
    module, attribute = COMMANDS[name].split(":")
    own = LazyGroup().get_command(None, name).help
    assert summary(f"printctl.cli.{module}", attribute) == inspect.cleandoc(own)


def test_the_list_of_commands_imports_none_of_them() -> None:
    code = LOADED.replace('"pause", "--help"', '"--help"').replace("registration", "numpy")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert all(f" {name} " in done.stdout for name in COMMANDS)
    assert done.stdout.splitlines()[-1] == "False"


def test_a_slip_of_the_pen_is_answered_with_what_may_have_been_meant():
    result = CliRunner().invoke(app, ["pauze"])
    assert result.exit_code == 2
    assert "pause" in result.output


def test_pausing_waits_for_no_library_of_another_command():
    done = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "False"
