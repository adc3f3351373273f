"""Command help: complete for every command, and the documentation page made from it."""

import re
import shlex

import pytest
import typer

from docs_tools.commands import PAGE, commands, page
from printctl.cli.help_examples import MANUAL

ALL = dict(commands())
LEAVES = {name: one for name, one in ALL.items() if not hasattr(one, "list_commands")}
UNIT = re.compile(
    r"-(mb|um|mm|s|ul|mmhg|ml|min|percent|kpa|px|gb|ratio|index|factor|gain|exponent|k)\b|-(mm|ml|mmhg|mpa|pa|ul|per)-"
    r"|-millimolar|°C|\b(mm|mm/s|min|s|µL|µm|g/cm³|µL/s)\b"
    r"|[Tt]imes real time|relative to real time|turns of the spiral"
)


def test_every_command_has_a_manual_and_no_other_does():
    assert set(ALL) == set(MANUAL), "printctl/cli/manual.txt wants an entry for every command"


@pytest.mark.parametrize("name", LEAVES)
def test_help_has_a_first_line_and_a_paragraph(name):
    first, *rest = LEAVES[name].help.strip().split("\n\n")
    assert first.rstrip().endswith((".", ":"))
    assert rest, f"{name}: one line says what, a paragraph what to mind"


@pytest.mark.parametrize("name", LEAVES)
def test_every_option_says_what_it_is(name):
    for param in LEAVES[name].params:
        assert param.help, f"{name} {param.opts}"


@pytest.mark.parametrize("name", LEAVES)
def test_every_number_says_its_unit(name):
    for param in LEAVES[name].params:
        if "float" in str(getattr(param, "type_descriptor", "")):
            assert UNIT.search(f"{param.opts[0]} {param.help}"), f"{name} {param.opts}"


@pytest.mark.parametrize("name", ALL)
def test_examples_are_right(name):
    for example in MANUAL[name].examples:
        assert example == f"printctl {name}" or example.startswith(f"printctl {name} ")
        words = shlex.split(example)[1 + len(name.split()) :]
        if name in LEAVES and name != "sim-printer":  # which hands on what it doesn't know
            LEAVES[name].parse_args(typer.Context(LEAVES[name], info_name=name), words)


@pytest.mark.parametrize("name", ALL)
def test_help_ends_with_examples_and_exit_codes(name):
    ALL[name].get_help(typer.Context(ALL[name], info_name=name))
    end = ALL[name].epilog
    assert MANUAL[name].examples[0] in end
    assert "Exit codes: 0 done" in end


def test_page_is_current():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: make docs"
