"""Parse the M115 reply; compare emergency parser and steps per mm (M92) with the profile."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_profiles import Printer

_CAP = re.compile(rb"Cap:(\w+):(\d)$")
_NAME = re.compile(rb"FIRMWARE_NAME: ?(.*?)(?:,? [A-Z-]+_[A-Z_]+:.*|,? ELECTRONICS:.*)?$")
_EXTRUDERS = re.compile(rb"EXTRUDER_COUNT:(\d+)")
_STEPS = re.compile(rb"([XYZE]):? ?(\d+\.\d+)")


@dataclass(frozen=True)
class Firmware:
    """Reply to M115.

    Attributes
    ----------
    name : str
        Text of ``FIRMWARE_NAME``; empty when it didn't come through.
    capabilities : dict of str to bool
    extruders : int
        Heads that it was built for (``EXTRUDER_COUNT``); 0 where it doesn't say.
    """

    name: str = ""
    capabilities: dict[str, bool] = field(default_factory=dict)
    extruders: int = 0

    def is_a(self, says: str) -> bool:
        """Whether its name contains ``says``, as every family's does (Marlin's forks too)."""
        return says in self.name.lower()


def parse_firmware(replies: Sequence[bytes]) -> Firmware:
    """Read the reply to M115."""
    name, extruders, capabilities = "", 0, {}
    for text in replies:
        if said := _NAME.search(text):
            name = said[1].decode("ascii", "replace")
            counted = _EXTRUDERS.search(text)
            extruders = int(counted[1]) if counted else 0
        elif match := _CAP.match(text):
            capabilities[match[1].decode()] = match[2] == b"1"
    return Firmware(name, capabilities, extruders)


def mode_lines(printer: Printer) -> tuple[bytes, ...]:
    """What a job takes for granted: mm, absolute places, and an absolute plunger if there is one.

    A Marlin without extruder doesn't know M82.
    """
    return (b"G21", b"G90") if printer.pneumatic else (b"G21", b"G90", b"M82")


def differences(firmware: Firmware, steps: Sequence[bytes], printer: Printer) -> list[str]:
    """Name what the firmware says otherwise than the profile.

    Parameters
    ----------
    firmware : Firmware
    steps : sequence of bytes
        Reply to M92.
    printer : Printer
    """
    all_differences = []
    parser = firmware.capabilities.get("EMERGENCY_PARSER")
    if parser is not None and parser != printer.emergency_parser:
        all_differences.append(
            f"EMERGENCY_PARSER is {'on' if parser else 'off'} in the firmware, "
            f"{'on' if printer.emergency_parser else 'off'} in the profile"
        )
    for text in steps:
        if b"M92" in text or text.startswith(b"Steps/mm:"):
            for axis, value in _STEPS.findall(text):
                expected = getattr(printer.steps_per_mm, axis.decode().lower())
                if abs(float(value) - expected) > 0.006:
                    all_differences.append(
                        f"{axis.decode()} makes {float(value):g} steps/mm in the firmware, "
                        f"{expected:g} in the profile (steps_per_mm)"
                    )
    return all_differences
