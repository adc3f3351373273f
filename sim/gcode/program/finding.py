"""Data class of a problem found in a G-code file: line, kind, message, value and limit."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One sort of problem in a file.

    Attributes
    ----------
    line : int
        Where it is first met, from 1.
    code : str
        Its sort: ``outside_x`` (y, z), ``speed_x`` (y, z, e), ``plunger_travel``,
        ``too_slow``, ``cold_extrusion``, ``unknown_command``, ``no_command``, ``bad_arc``,
        ``homing``, ``long_line``, ``no_such_head``, ``head_not_chosen``, ``plunger_not_counted``,
        ``offset_twice``, ``offset_unknown``, ``empty_file``, or one of
        `sim.gcode.reading.faults.SORTS`.
    message : str
        For the user: what, value, limit, remedy.
    value, limit : float
        The worst value and what it should have kept; NaN where there is none.
    count : int
        Rows of the program concerned.
    """

    line: int
    code: str
    message: str
    value: float = float("nan")
    limit: float = float("nan")
    count: int = 1
