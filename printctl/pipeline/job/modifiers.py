"""Parse modifier meshes (FILE:setting=value,...): regions with their own infill or head."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast, get_args

from design.toolpath.fresh import Filling, Infill
from printctl.errors import UsageError

SETTINGS: Final = ("infill", "infill-percent", "infill-angles", "head")


@dataclass(frozen=True)
class Modifier:
    """A mesh inside which the part is filled in another way, or written by another head.

    Attributes
    ----------
    path : Path
    infill : "lines", "concentric", "gyroid" or None
        None keeps the part's own, here and below.
    percent : float or None
    angles_deg : tuple of float or None, °
    head : int or None
    """

    path: Path
    infill: Infill | None = None
    percent: float | None = None
    angles_deg: tuple[float, ...] | None = None
    head: int | None = None

    def filling(self, part: Filling) -> Filling:
        """The part's own filling, changed by what the modifier says."""
        return Filling(
            self.infill or part.pattern,
            part.density if self.percent is None else self.percent * 1e-2,
            self.angles_deg or part.angles_deg,
        )


def read_modifier(text: str, head_count: int) -> Modifier:
    """Read ``FILE:setting=value,...``; angles of one setting are parted by slashes.

    Raises
    ------
    UsageError
        For a text without settings, an unknown setting, or a value out of its range.
    """
    path, colon, settings = text.rpartition(":")
    if not colon or "=" not in settings:
        raise UsageError(
            f"--modifier {text!r} doesn't say what it changes; write it like "
            "core.stl:infill=gyroid,infill-percent=30"
        )
    texts: dict[str, str] = {}
    for word in settings.split(","):
        name, _, value = word.partition("=")
        name = name.strip()
        if name not in SETTINGS:
            raise UsageError(
                f"--modifier {text!r}: {name!r} can't be changed in a place; known are "
                f"{', '.join(SETTINGS)}"
            )
        texts[name] = value.strip()
    return Modifier(
        Path(path),
        _pattern(texts.get("infill"), text),
        _number(texts.get("infill-percent"), text, "infill-percent", 100.0),
        _angles(texts.get("infill-angles"), text),
        _head(texts.get("head"), text, head_count),
    )


def _pattern(value: str | None, text: str) -> Infill | None:
    if value is None or value in get_args(Infill):
        return cast("Infill | None", value)
    raise UsageError(
        f"--modifier {text!r}: infill is {value!r}; it must be one of {', '.join(get_args(Infill))}"
    )


def _number(value: str | None, text: str, name: str, most: float) -> float | None:
    if value is None:
        return None
    try:
        number = float(value)
    except ValueError:
        number = -1.0
    if not 0 <= number <= most:
        raise UsageError(
            f"--modifier {text!r}: {name} is {value!r}; it must be a number within 0 to {most:g}"
        )
    return number


def _angles(value: str | None, text: str) -> tuple[float, ...] | None:
    if value is None:
        return None
    try:
        angles = tuple(float(word) for word in value.split("/"))
    except ValueError:
        angles = (math.nan,)
    if not all(map(math.isfinite, angles)):
        raise UsageError(
            f"--modifier {text!r}: infill-angles is {value!r}; write degrees, layer after layer, "
            "like 45/135"
        )
    return angles


def _head(value: str | None, text: str, count: int) -> int | None:
    if value is None:
        return None
    if value not in map(str, range(count)):
        raise UsageError(
            f"--modifier {text!r}: head is {value!r}; the printer has {count}, counted from 0"
        )
    return int(value)
