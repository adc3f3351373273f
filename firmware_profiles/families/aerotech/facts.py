"""Aerotech's family record: known codes, dialect; runs program files, takes no streamed lines."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from firmware_profiles.errors import ProfileError
from firmware_profiles.families.dialect import WORDS, Dialect
from firmware_profiles.families.family import Family
from firmware_profiles.families.grammar import MOVE, Grammar, Meaning, codes

if TYPE_CHECKING:
    from firmware_profiles.file_controller import FileController
    from firmware_profiles.printers import Printer


_WORDS: Final = {
    "G0": MOVE,
    "G1": MOVE,
    "G4": "S",
    "G20": "",
    "G21": "",
    "G90": "",
    "G91": "",
    "G92": "X Y Z E",
}
_NO_MOTION: Final = frozenset({"$", "ENABLE", "DISABLE", "DWELL", "WAIT", "WAITFORMOTIONDONE"})
_CALLS: Final = {"VELOCITYBLENDINGON", "CORNERROUNDINGON"}


def dialect_of(printer: Printer) -> Dialect:
    """Return the dialect of the printer's controller.

    Raises
    ------
    ProfileError
        When the profile doesn't say which it is.
    """
    if printer.file_controller is None:
        raise ProfileError(
            f"profile {printer.name!r} doesn't say which Aerotech controller it is for; give it "
            "(file_controller: {controller: a3200})"
        )
    return _completed(printer, printer.file_controller)


FAMILY: Final = Family(
    grammar=Grammar(
        codes=codes("G", 0, 1, 4, 20, 21, 90, 91, 92) | codes("M", 105, 400),
        names=dict.fromkeys(
            ("$DO", "DIGITALOUTPUTSET", "BRAKE", "DRIVEBRAKE", "SETS_PRESSURE"), Meaning.OTHER
        ),
        words=_WORDS,
    ),
    dialect=dialect_of,
    file_controllers={
        "a3200": ("$DO", "BRAKE "),
        "automation1": ("DigitalOutputSet", "DriveBrake"),
    },
    setup_words={
        "a3200": _NO_MOTION | {"VELOCITY", "ROUNDING", "DVAR", "M2"},
        "automation1": _NO_MOTION | {"VAR", *_CALLS},
    },
)
"""Codes are those that its commands are translated into before they are read; names are the
commands that set an output, a brake or a pressure."""


# The file is loaded by the controller's own software. Automation1's help
# (help.aerotech.com/automation1, "G-Code Programming"): G90; G76, time in seconds, so that F is
# mm/s; G0 moves each axis at its own rate, not along a line, so travels are G1 here; ``//`` begins
# a comment. A3200: mecode's own program text (github.com/jminardi/mecode, header.txt and
# footer.txt): ``$DO0.0=0``, ``G4 P0.15`` in seconds; ORNL Slicer 2, aerobasic_writer.cpp:
# ``VELOCITY ON`` keeps the head from stopping at each move's end, ``$DO[0].X=1``, F in mm/s; G71
# and G92 as in the programs of others. ``;`` begins a comment in mecode's files, but would part two
# statements in AeroScript, so it isn't used. A valve on an axis' brake, several vertical axes and
# pressures by a call: the files of the Skylar-Scott lab's rig (github.com/sohams-MASS/X-CAVATE,
# commit 5758b1422dfa, tests/verification_harness) have ``BRAKE Aa 0`` and ``Call setPress``, its
# writer for Automation1 ``DriveBrakeOff(Aa)``.
_COMMON: Final = Dialect(
    clean=(),
    modes=("G71", "G76", "G90"),
    absolute_e=(),
    feed_s=1.0,
    feed_decimals=5,
    dwell_decimals=3,
    travels=1,
    comment="//",
    counts_anew=False,
)
_BLENDING: Final = {"a3200": "VELOCITY ON", "automation1": "G108"}
_WAITS: Final = {"a3200": "WAIT MOVEDONE {}", "automation1": "WaitForMotionDone([{}])"}


def _completed(printer: Printer, chosen: FileController) -> Dialect:
    """Blending and waiting in the controller's language; the axes' letters, the lab's own lines."""
    letter = chosen.plunger_axis or ""
    axes = ["X", "Y", *dict.fromkeys(printer.z_axes), *letter]
    between = " " if chosen.controller == "a3200" else ", "
    return replace(
        _COMMON,
        modes=(*_COMMON.modes, _BLENDING[chosen.controller]),
        waits=_WAITS[chosen.controller].format(between.join(axes)),
        words=WORDS.replace(b"E", (letter or "E").encode()),
        begins=chosen.begins,
        ends=chosen.ends,
    )
