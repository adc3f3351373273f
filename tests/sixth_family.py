"""Test double: a sixth firmware family, added as two folders.

It has Klipper's kind of link, Marlin's words but no arcs, a question of its own (M777) and a
timeout under another name; its simulated twin answers M777.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import firmware_profiles.families as facts
import sim.devices.families as twins
from firmware_profiles import Printer, load
from firmware_profiles.families import find_family, meanings
from firmware_profiles.load import DATA
from gcode.reading.line import accepted_letters, family_part
from printctl.checks.gate.rules import rules

NAME = "sixthware"
FACTS = '''
"""Facts about a made-up firmware."""

from firmware_profiles.families.ack_protocol import AckProtocol, Sort
from firmware_profiles.families.grammar import COMMON
from firmware_profiles.families.dialect import Dialect, same_dialect
from firmware_profiles.families.family import AllowQuery, Family
from firmware_profiles.families.grammar import Grammar, codes


class SixthProtocol(AckProtocol):
    """One line in flight, without numbers."""

    def frame(self, number, command):
        return command + b"\\n"

    def sort(self, text):
        if text.startswith(b"echo:Unknown command"):
            return Sort.REFUSAL
        return Sort.OK if text == b"ok" or text.startswith(b"ok ") else Sort.TEXT


FAMILY = Family(
    reported_name="sixth",
    make_protocol=lambda one: SixthProtocol(one.places, one.timing),
    grammar=Grammar(
        codes=codes("G", 0, 1, 4, 21, 28, 90, 92)
        | codes("M", 82, 85, 104, 105, 112, 114, 115, 140, 220, 221, 400, 777),
        words={**COMMON, "M777": ""},
        lower_case=False,
    ),
    dialect=same_dialect(Dialect("M85 S{seconds}", clean=("M220 S100", "M221 S100"))),
    console_rules={"M777": AllowQuery()},
    setting_questions=(b"M115",),
    timeout_code="M85",
    timeout_example="M85 S600",
)
'''
TWIN = '''
"""The printer that plays it."""

from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.marlin_printer import Marlin


def _m777(board, command):
    board.machine.say("seven hundred and seventy-seven")


def _m115(board, command):
    board.machine.say("FIRMWARE_NAME:Sixthware 1.0")


class Sixth(Marlin):
    """Marlin with a question more."""

    handlers = {**Marlin.handlers, "M115": _m115, "M777": _m777}


class SixthPrinter(SimulatedPrinter):
    """A board with it."""

    firmware_class = Sixth


PRINTER = SixthPrinter
'''


@contextmanager
def installed(folder: Path) -> Iterator[Printer]:
    """Put both beside the other families', and give a profile that names the family."""
    paths = {facts: folder / "facts", twins: folder / "twins"}
    files = f"{NAME}/__init__.py", f"{NAME}_printer.py"
    for home, name, text in zip(paths, files, (FACTS, TWIN), strict=True):
        file = paths[home] / name
        file.parent.mkdir(parents=True)
        file.write_text(text.lstrip())
        home.__path__.append(str(paths[home]))
    try:
        yield _profile(folder)
    finally:
        for home, path in paths.items():
            home.__path__.remove(str(path))
        for remembers in (find_family, meanings, family_part, accepted_letters, rules):
            remembers.cache_clear()


def _profile(folder: Path) -> Printer:
    text = (DATA / "printers" / "generic_marlin.yaml").read_text(encoding="utf-8")
    path = folder / "sixth.yaml"
    path.write_text(text.replace("firmware: marlin", f"firmware: {NAME}"), encoding="utf-8")
    return load(Printer, str(path))
