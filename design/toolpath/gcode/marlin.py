"""What is Marlin's own about a job: its first and last lines."""

from __future__ import annotations

from firmware_profiles import Printer


class Marlin:
    """Marlin 2; see https://marlinfw.org/meta/gcode/ for each command."""

    def header(self, printer: Printer) -> list[str]:
        """Lines before the first move.

        No homing: the needle may stand in the bath. M85 switches the motors off when a killed
        host falls silent; M302 P1 allows the plunger to move without a hot end.
        """
        return [f"M85 S{printer.idle_timeout_s:.0f}", "G21", "G90", "M82", "M302 P1"]

    def footer(self) -> list[str]:
        """Lines after the last move: wait until it has ended."""
        return ["M400"]
