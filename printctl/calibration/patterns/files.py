"""Convert a calibration pattern with its profiles to JSON text; read a pattern's JSON file."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from printctl.calibration.patterns.plan import Bead, Pattern, Question, Stroke
from printctl.errors import UsageError

VERSION: Final = 1
_MOST_ID: Final = 1_000_000
_KEY: Final = "printctl_pattern"


@dataclass(frozen=True)
class PatternSetUp:
    """What a pattern was written with.

    Attributes
    ----------
    printer, syringe, ink, needle : str
        Profiles as the user named them.
    flow_factor : float
        Of the ink, by which the G-code's plunger is driven.
    swell_factor : float or None
        Of the ink, as its profile had it.
    """

    printer: str
    syringe: str
    ink: str
    needle: str
    flow_factor: float
    swell_factor: float | None


@dataclass(frozen=True)
class WrittenPattern:
    """A pattern with what it was written with.

    Attributes
    ----------
    pattern : Pattern
    mounted : PatternSetUp
    at_mm : (x, y, z) or None
        Printer's place of the frame's middle, at the height of the lines; files of before don't say
        it.
    """

    pattern: Pattern
    mounted: PatternSetUp
    at_mm: tuple[float, float, float] | None = None

    @property
    def number(self) -> int:
        """Tells one print from another: a check sum, below a million."""
        return zlib.crc32(_text(self).encode()) % _MOST_ID

    def as_text(self) -> str:
        """JSON."""
        return _text(self, {"number": self.number}) + "\n"


def read_pattern(path: Path) -> WrittenPattern:
    """Read a pattern's file.

    Raises
    ------
    UsageError
        When it isn't there, isn't one, or was changed by hand.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise UsageError(
            f"{path} can't be read: {exc.strerror}; give the file that `printctl calibrate "
            "pattern` wrote beside the G-code (--pattern)"
        ) from exc
    except ValueError as exc:
        raise UsageError(f"{path} isn't a pattern's file: {exc}; give the .json one") from exc
    if not isinstance(data, dict) or data.get(_KEY) != VERSION:
        raise UsageError(f"{path} isn't a pattern's file of `printctl calibrate pattern`")
    try:
        pattern = _read(data)
    except (KeyError, TypeError, ValueError) as exc:
        raise UsageError(f"{path} isn't whole ({exc}); write the pattern again") from exc
    if pattern.number != data.get("number"):
        raise UsageError(
            f"{path} was changed since it was written, so it may not be what was printed; write "
            "the pattern again"
        )
    return pattern


def _text(written: WrittenPattern, more: dict[str, Any] | None = None) -> str:
    pattern = written.pattern
    data = {
        _KEY: VERSION,
        **(more or {}),
        "name": pattern.name,
        "mounted": asdict(written.mounted),
        "bead": asdict(pattern.bead),
        "size_mm": _rounded(pattern.size_mm),
        **({} if written.at_mm is None else {"at_mm": _rounded(written.at_mm)}),
        "strokes": [
            {
                "number": stroke.number,
                "role": stroke.role,
                "flow": stroke.flow,
                "speed_mm_s": _speeds(stroke),
                "points_mm": _rounded(stroke.points),
            }
            for stroke in pattern.strokes
        ],
        "questions": [
            {"number": one.number, "value": one.value, "lines_mm": _rounded(one.lines)}
            for one in pattern.questions
        ],
    }
    return json.dumps(data, indent=None if more is None else 1, allow_nan=False)


def _speeds(stroke: Stroke) -> list[float]:
    """One number where all are the same."""
    speeds: list[float] = stroke.speed_mm_s.tolist()
    return speeds[:1] if len(set(speeds)) == 1 else speeds


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, dtype=np.float64), 6).tolist()


def _read(data: dict[str, Any]) -> WrittenPattern:
    strokes = []
    for one in data["strokes"]:
        points = np.array(one["points_mm"], dtype=np.float64).reshape(-1, 3)
        speed = np.broadcast_to(np.array(one["speed_mm_s"], dtype=np.float64), len(points) - 1)
        strokes.append(Stroke(one["number"], one["role"], points, speed, one["flow"]))
    questions = tuple(
        Question(one["number"], one["value"], np.array(one["lines_mm"]).reshape(-1, 2, 2))
        for one in data["questions"]
    )
    x, y = data["size_mm"]
    pattern = Pattern(data["name"], Bead(**data["bead"]), (x, y), tuple(strokes), questions)
    mounted = PatternSetUp(**data["mounted"])
    if data.get("at_mm") is None:
        return WrittenPattern(pattern, mounted)
    at_x, at_y, at_z = map(float, data["at_mm"])
    return WrittenPattern(pattern, mounted, (at_x, at_y, at_z))
