"""`printctl calibrate`: group of subcommands that measure constants of printer, ink and scanner.

A subcommand with a test has two ways: ``--gcode FILE`` writes the G-code and, beside it, a CSV file
to fill in; with that file as argument it fits. No profile is written but with ``--write``.
"""

from __future__ import annotations

import typer

from printctl.calibration.results import level_result
from printctl.cli.calibrate_camera import board, camera
from printctl.cli.calibrate_measured import backlash, lag, offset, weigh
from printctl.cli.calibrate_oct import oct_device, walls
from printctl.cli.calibrate_options import Csv, numbers_of, print_estimates, read_csv_argument
from printctl.cli.calibrate_pattern import pattern, widths
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag
from printctl.settings import opt


@command
def level(
    readings: Csv = None,
    part: str = opt("Size of the part, mm.", "20,20", metavar="X,Y"),
    as_json: JsonFlag = False,
) -> None:
    """Level of bed and bath: CSV with surface (bed or bath), x_mm, y_mm and z_mm of touches.

    Three places of each at least, not in a row; more tell how sure the tilt is.
    """
    data = read_csv_argument(readings, ("x_mm", "y_mm", "z_mm"), ("surface",))
    size = numbers_of(part, "--part")
    result = level_result(data, size[0], size[-1])
    print_estimates(result.lines, list(result.notes), as_json)


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
