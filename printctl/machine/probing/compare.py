"""Compare a printer's settings with a profile: a table, and a corrected profile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from firmware_profiles import Printer
from printctl.machine.probing.settings import Settings

RELATIVE = 1e-4
ABSOLUTE = 0.006
"""Firmwares print two decimals, some one in mm/min."""


@dataclass(frozen=True)
class Row:
    """Comparison of one profile key.

    Attributes
    ----------
    key : str
    profile, printer : float or bool
    same : bool
        Within what the firmware prints.
    starting : bool
        Whether the profile says that its number was never measured.
    """

    key: str
    profile: float | bool
    printer: float | bool
    same: bool
    starting: bool


def compare(settings: Settings, profile: Printer) -> list[Row]:
    """A row for each key that the printer tells, those that differ first."""
    rows = []
    for key, reported in settings.values.items():
        name, _, part = key.partition(".")
        mine = getattr(profile, name)
        mine = getattr(mine, part) if part else mine
        same = (
            reported == mine if isinstance(reported, bool) else _near(float(mine), float(reported))
        )
        starting = key in profile.starting_values or name in profile.starting_values
        rows.append(Row(key, mine, reported, same, starting))
    return sorted(rows, key=lambda row: (row.same, row.key))


def _near(one: float, other: float) -> bool:
    return abs(one - other) <= max(ABSOLUTE, RELATIVE * abs(one))


def corrected_profile(profile: Printer, rows: list[Row], port: str, day: str) -> dict[str, Any]:
    """The profile with the printer's own values, as a mapping to write as YAML.

    What the printer told is no starting value any more, whether it differed or not.

    Raises
    ------
    ValueError
        When the values make no profile (a span without width, say).
    """
    data = profile.model_dump(mode="json", exclude_unset=True)
    for row in rows:
        if row.same:
            continue
        name, _, part = row.key.partition(".")
        if part:
            whole = getattr(profile, name).model_dump(mode="json")
            data[name] = {**whole, **data.get(name, {}), part: row.printer}
        else:
            data[name] = row.printer
    reported = {row.key for row in rows}
    data["starting_values"] = _still_starting(profile, reported)
    if not data["starting_values"]:
        del data["starting_values"]
    changed = ", ".join(row.key for row in rows if not row.same) or "nothing"
    data["source"] = f"{profile.source} Read from the printer on {port}, {day}: {changed}."
    Printer.model_validate(data)
    return data


def _still_starting(profile: Printer, reported: set[str]) -> list[str]:
    """Starting values that the printer hasn't told, whole or in part."""
    left = []
    for name in profile.starting_values:
        value = getattr(profile, name.partition(".")[0])
        parts = [] if "." in name else list(getattr(type(value), "model_fields", {}))
        missing = [f"{name}.{part}" for part in parts if f"{name}.{part}" not in reported]
        if parts and len(missing) < len(parts):
            left += missing
        elif name not in reported and (missing or not parts):
            left.append(name)
    return left
