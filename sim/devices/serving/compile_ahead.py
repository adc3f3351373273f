"""Compile every kernel of the simulated printer, or load it from the cache, in advance."""

from __future__ import annotations

from firmware_profiles import Printer, load
from sim.devices.families.registry import simulated_printer
from sim.gcode.program.gcode import checksum

_FILE = b"M302 P1\nG92 X0 Y0 Z0 E0\nG1 X1 E1 F600\nG2 X2 I1\nG28 X\nM400\n"


def warm_printer() -> None:
    """Put each kernel that takes G-code through one call, on the short road and the general one."""
    profile = load(Printer, "marlin_avr")
    printer = simulated_printer(profile)(profile)
    printer.exchange(_FILE)
    body = b"N1 G1 X3 E2"
    printer.exchange(b"%s*%d\n" % (body, checksum(body)))
    printer.exchange(b"G4 S1\nM114\n")
    printer.kill("warm")
    printer.executed()
    heads = load(Printer, "two_syringe_marlin")
    simulated_printer(heads)(heads).exchange(b"T1 S1\nM400\n")
