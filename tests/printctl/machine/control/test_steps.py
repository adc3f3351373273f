"""No step is forgotten: each call of one is waited for by ``yield from``, or driven by a shell."""

from __future__ import annotations

import ast
from pathlib import Path

import printctl.machine as room
from tests.printctl.machine.control.calls import STEP_CLASSES, Source, forgotten

ROOT = Path(room.__file__).parent
SOURCES = [
    Source.read(path)
    for path in sorted(
        [*ROOT.glob("control/**/*.py"), *ROOT.glob("process/*.py"), *ROOT.glob("*.py")]
    )
]


def test_each_step_is_waited_for_or_driven():
    assert forgotten(SOURCES) == []


def test_the_table_of_receivers_names_each_class_that_has_steps():
    with_steps = {
        name
        for source in SOURCES
        for name, functions in source.classes.items()
        if any(function.waits for function in functions.values())
    }
    assert with_steps - {"Streamer"} == set(STEP_CLASSES.values())


def test_a_forgotten_step_is_found():
    library = Source.parse(
        "printctl.machine.control.library",
        "class Channel:\n"
        "    def command(self) -> Steps[None]:\n        yield Wait(0.0)\n"
        "    def twice(self) -> Steps[None]:\n        self.command()\n"
        "        yield from self.command()\n"
        "def leave(run) -> Steps[bool]:\n"
        "    run.channel.command()\n    return (yield from run.channel.command())\n",
    )
    caller = Source.parse(
        "printctl.machine.process.caller",
        "from printctl.machine.control.library import leave\n"
        "def go(run):\n    if leave(run):\n        drive(leave(run), run.wiring)\n"
        "    unknown.command()\n",
    )
    found = [one.partition(": ")[2] for one in forgotten([library, caller])]
    assert found == [
        "self.command()",
        "run.channel.command()",
        "leave(run)",
        "whose is unknown.command()",
    ]


def test_steps_touch_no_clock_port_or_file():
    """Queries of the port's name and of who else reads it, and of the disk's room, are left."""
    allowed = {"shell", "streamer", "halting", "wiring"}  # a kill is a thread's own path
    for source in SOURCES:
        path = source.module.removeprefix("printctl.machine.").split(".")
        if path[0] != "control" or path[-1] in allowed:
            continue
        for node in ast.walk(source.tree):
            if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute)):
                continue
            owner = node.value.attr
            if owner in ("clock", "journal", "transport"):
                assert node.attr in ("name", "free_bytes"), f"{path[-1]}: {ast.unparse(node)}"
