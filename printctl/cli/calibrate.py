"""`printctl calibrate`: group of subcommands that measure constants of printer, ink and scanner.

A subcommand with a test has two ways: ``--gcode FILE`` writes the G-code and, beside it, a CSV file
to fill in; with that file as argument it fits. No profile is written but with ``--write``.
"""

from __future__ import annotations

import typer

from printctl.cli.calibrate_backlash import backlash
from printctl.cli.calibrate_camera import board, camera
from printctl.cli.calibrate_lag import lag
from printctl.cli.calibrate_level import level
from printctl.cli.calibrate_oct import oct_device, walls
from printctl.cli.calibrate_offset import offset
from printctl.cli.calibrate_pattern import pattern
from printctl.cli.calibrate_weigh import weigh
from printctl.cli.calibrate_widths import widths

calibrate = typer.Typer(
    help="Measure a machine's and an ink's constants, each with its uncertainty.",
    no_args_is_help=True,
)
calibrate.command("weigh")(weigh)
calibrate.command("offset")(offset)
calibrate.command("level")(level)
calibrate.command("backlash")(backlash)
calibrate.command("lag")(lag)
calibrate.command("pattern")(pattern)
calibrate.command("widths")(widths)
calibrate.command("board")(board)
calibrate.command("camera")(camera)
calibrate.command("oct")(oct_device)
calibrate.command("walls")(walls)
