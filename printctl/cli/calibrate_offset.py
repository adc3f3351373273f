"""`printctl calibrate offset`: where one needle's tip stands against another's."""

from __future__ import annotations

import numpy as np

from printctl.calibration import fit_offset
from printctl.cli.calibrate_options import Csv, given, tell
from printctl.cli.options import JsonFlag
from printctl.errors import UsageError


def offset(readings: Csv = None, as_json: JsonFlag = False) -> None:
    """Offset of a needle: CSV with needle (two names), x_mm, y_mm and z_mm of touch-offs."""
    data = given(readings, ("x_mm", "y_mm", "z_mm"), ("needle",))
    names = list(dict.fromkeys(data.words["needle"]))
    if len(names) != 2:
        raise UsageError(f"needles {', '.join(names)}: give touch-offs of exactly two")
    places = []
    for name in names:
        rows = [word == name for word in data.words["needle"]]
        columns = [data.numbers[axis][rows].tolist() for axis in ("x_mm", "y_mm", "z_mm")]
        places.append([list(place) for place in zip(*columns, strict=True)])
    first, second = (np.array(place) for place in places)
    found = fit_offset(first, second, max(data.last_digit.values()))
    lines = {f"{names[1]} less {names[0]}, {axis}": e for axis, e in zip("xyz", found, strict=True)}
    tell(
        lines,
        [f"add it to place_mm when {names[1]} prints what {names[0]} was set up for"],
        as_json,
    )
