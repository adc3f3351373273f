"""`printctl calibrate level`: fit slopes of bed and bath, and bath depth, to touched points."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.calibration.results import level_result
from printctl.cli.calibrate_options import Csv, numbers_of, print_estimates, read_csv_argument
from printctl.cli.options import JsonFlag


def level(
    readings: Csv = None,
    part: Annotated[
        str, typer.Option("--part", metavar="X,Y", help="Size of the part, mm.")
    ] = "20,20",
    as_json: JsonFlag = False,
) -> None:
    """Level of bed and bath: CSV with surface (bed or bath), x_mm, y_mm and z_mm of touches.

    Three places of each at least, not in a row; more tell how sure the tilt is.
    """
    data = read_csv_argument(readings, ("x_mm", "y_mm", "z_mm"), ("surface",))
    size = numbers_of(part, "--part")
    result = level_result(data, size[0], size[-1])
    print_estimates(result.lines, list(result.notes), as_json)
