"""Files of a calibration pattern: JSON, measuring sheet (CSV) and drawing (SVG)."""

from __future__ import annotations

import csv
import io
import json
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from kernels.arrays import FloatArray
from printctl.calibration.patterns.plan import Bead, Pattern, Question, Stroke
from printctl.checks.made_for import made_for, read_made_for, refuse_other
from printctl.checks.set_up import HeadLoading
from printctl.errors import UsageError

VERSION: Final = 1
_MOST_ID: Final = 1_000_000
_KEY: Final = "printctl_pattern"
Point = tuple[float, float, float]


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
    recorded : tuple of str
        Names and hashes of the profiles, as in the G-code's header; empty in files of before.
    """

    printer: str
    syringe: str
    ink: str
    needle: str
    flow_factor: float
    swell_factor: float | None
    recorded: tuple[str, ...] = ()

    def refuse_other(self, ink: str | None = None) -> None:
        """Raise `SafetyError` where a profile was changed since, or ``ink`` is another one."""
        syringe, of_ink, needle = self.syringe, ink or self.ink, self.needle
        filled = HeadLoading(load(Syringe, syringe), load(Ink, of_ink), load(Needle, needle))
        recorded = read_made_for("\n".join(f"; {one}" for one in self.recorded).encode())
        refuse_other(recorded, made_for(load(Printer, self.printer), [filled]))


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
    at_mm: Point | None = None

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


def read_printed_lines(path: Path) -> list[tuple[Point, Point, float]]:
    """Read the straight lines of a pattern's squares or frame: both ends and width, mm.

    The ends are the printer's.

    Raises
    ------
    UsageError
        As `read_pattern`, and of a file that doesn't say where it was printed.
    """
    written = read_pattern(path)
    pattern, at = written.pattern, written.at_mm
    if at is None:
        raise UsageError(
            f"{path} doesn't say where it was printed: a former printctl wrote it; write and print "
            "the pattern again (printctl calibrate pattern squares)"
        )
    corner = np.array([at[0] - pattern.size_mm[0] / 2, at[1] - pattern.size_mm[1] / 2, at[2]])
    return [
        (tuple(one), tuple(other), pattern.bead.width_mm)
        for stroke in pattern.of_role("side", "frame")
        for one, other in pairwise((stroke.points + corner).tolist())
    ]


def _text(written: WrittenPattern, more: dict[str, Any] | None = None) -> str:
    pattern = written.pattern
    data = {
        _KEY: VERSION,
        **(more or {}),
        "name": pattern.name,
        "mounted": {key: value for key, value in asdict(written.mounted).items() if value != ()},
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
    recorded = tuple(data["mounted"].get("recorded", ()))
    mounted = PatternSetUp(**{**data["mounted"], "recorded": recorded})
    if data.get("at_mm") is None:
        return WrittenPattern(pattern, mounted)
    at_x, at_y, at_z = map(float, data["at_mm"])
    return WrittenPattern(pattern, mounted, (at_x, at_y, at_z))


COLUMNS: Final = {
    "lines": ("line", "x_mm", "speed_mm_s", "flow", "expected_mm", "width_mm"),
    "spiral": ("line", "x_mm", "speed_mm_s", "flow", "expected_mm", "width_mm"),
    "comb": ("gap", "commanded_mm", "expected_mm", "gap_mm"),
    "joint": ("joint", "overlap_radii", "gap_mm"),
    "bridge": ("bridge", "span_mm", "held"),
}
HINTS: Final = {
    "lines": "width_mm at x_mm from the line's begin (the dot); leave blank where there is none",
    "spiral": "width_mm at x_mm along the line from its begin, in the middle (the dot)",
    "comb": "gap_mm between edges; 0 where the teeth touch",
    "joint": "gap_mm between the branch's end and the trunk; 0 where they are joined",
    "bridge": "held: 1 where the line bridges the gap, 0 where it sank or broke",
}
CLEAR: Final = 1.0
"""Widths to either side of a step of speed that aren't measured."""
_PLAIN: Final = (0.55, 0.7, 0.85)
_AFTER: Final = (0.03, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 0.95)
_STEADY: Final = (0.55, 0.75, 0.95)
_SPIRAL: Final = 24


def sheet_text(written: WrittenPattern) -> str:
    """Return the CSV file with its last column to be filled in."""
    pattern = written.pattern
    return _table(written, [[*row, ""] for row in _rows(pattern, written.mounted.swell_factor)])


def filled_text(written: WrittenPattern, rows: Iterable[list[str]]) -> str:
    """Return the CSV file with rows that were measured."""
    return _table(written, rows)


def width_row(stroke: Stroke, x_mm: float, pattern: Pattern, swell: float | None) -> list[str]:
    """Columns of a width before its last one."""
    expected = pattern.bead.width_at(stroke.flow) * (swell or 1.0)
    speed = speed_at(stroke, np.array([x_mm]))[0]
    return [f"{stroke.number}", f"{x_mm:.3f}", f"{speed:g}", f"{stroke.flow:g}", f"{expected:.4f}"]


def speed_at(stroke: Stroke, x_mm: FloatArray) -> FloatArray:
    """Commanded speed at places along a stroke, (n,), mm/s."""
    ends = np.cumsum(np.linalg.norm(np.diff(stroke.points, axis=0), axis=1))
    at = np.searchsorted(ends - 1e-9, x_mm, side="left")
    return np.asarray(stroke.speed_mm_s[np.minimum(at, len(ends) - 1)])


def _table(written: WrittenPattern, rows: Iterable[list[str]]) -> str:
    text = io.StringIO()
    text.writelines(f"# {line}\n" for line in written.mounted.recorded)
    text.write(f"# pattern={written.number}\n# {HINTS[written.pattern.name]}\n")
    columns = list(COLUMNS[written.pattern.name])
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    return text.getvalue()


def _rows(pattern: Pattern, swell: float | None) -> list[list[str]]:
    if pattern.name in ("lines", "spiral"):
        return [
            width_row(stroke, x, pattern, swell)
            for stroke in pattern.of_role("line", "step", "spiral")
            for x in _places(stroke, pattern.bead.width_mm)
        ]
    wide = pattern.bead.width_mm * ((swell or 1.0) - 1.0)
    return [
        [
            f"{one.number}",
            f"{one.value:g}",
            *([f"{max(one.value - wide, 0.0):.4f}"] if pattern.name == "comb" else []),
        ]
        for one in pattern.questions
    ]


def _places(stroke: Stroke, width_mm: float) -> list[float]:
    """Where to measure: where a line is steady, and close together after a change of speed."""
    length = stroke.length_mm
    if stroke.role == "line":
        return [length * part for part in _PLAIN]
    if stroke.role == "spiral":
        return (length * (np.arange(_SPIRAL) + 0.5) / _SPIRAL).tolist()
    stretch = length / 3
    parts = ((0, _STEADY), (1, _AFTER), (2, _AFTER))
    clear = CLEAR * width_mm
    return [stretch * k + max(stretch * part, clear) for k, which in parts for part in which]


_SCALE: Final = 5.0
"""Drawn larger than it is."""
_SIDE_MM: Final = 30.0
_RIGHT_MM: Final = 50.0
_LINE_MM: Final = 4.2
_STYLE: Final = (
    "text{font:2.6px sans-serif;fill:#222} .small{font-size:2.2px} "
    "polyline,line{fill:none;stroke-linecap:round;stroke-linejoin:round} "
    ".frame{stroke:#888} .ink{stroke:#2a5d9f} .step{stroke:#b5551d}"
)


def sheet_svg(written: WrittenPattern) -> str:
    """Return the sheet as SVG, y up as the printer's."""
    pattern = written.pattern
    x, y = (side * _SCALE for side in pattern.size_mm)
    legend = list(_legend(written))
    wide, high = x + _SIDE_MM + _RIGHT_MM, y + 2 * _SIDE_MM + _LINE_MM * len(legend)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:g}mm" height="{high:g}mm" '
        f'viewBox="0 0 {wide:g} {high:g}"><style>{_STYLE}</style>'
        '<rect width="100%" height="100%" fill="#fff"/>',
        f'<g transform="translate({_SIDE_MM:g} {y + _SIDE_MM:g})">',
        *(_drawn(pattern, stroke) for stroke in _flat(pattern)),
        *_labels(pattern),
        *_scales(pattern),
        "</g>",
    ]
    for row, text in enumerate(legend):
        at = y + 2 * _SIDE_MM - 8 + row * _LINE_MM
        parts.append(f'<text x="{_SIDE_MM / 2:g}" y="{at:g}">{escape(text)}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def _flat(pattern: Pattern) -> list[Stroke]:
    """What is drawn: of a pillar its first layer."""
    return [one for one in pattern.strokes if one.role != "pillar" or one.points[0, 2] == 0]


def _place(point: list[float]) -> tuple[float, float]:
    return point[0] * _SCALE, -point[1] * _SCALE


def _drawn(pattern: Pattern, stroke: Stroke) -> str:
    kind = stroke.role if stroke.role in ("frame", "step") else "ink"
    width = pattern.bead.width_at(stroke.flow) * _SCALE
    places = [_place(point) for point in stroke.points.tolist()]
    path = " ".join(f"{u:.2f},{v:.2f}" for u, v in places)
    (u, v), dot = places[0], max(0.35 * width, 0.5)
    return (
        f'<polyline class="{kind}" stroke-width="{width:.2f}" points="{path}"/>'
        f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{dot:.2f}" fill="#fff" stroke="#222" '
        'stroke-width=".2"/>'
    )


def _labels(pattern: Pattern) -> Iterator[str]:
    """Numbers: of lines beside their begin and end, of gaps, joints and bridges beside them."""
    right = pattern.size_mm[0] * _SCALE + 2
    for stroke in pattern.of_role("line", "step"):
        v = -stroke.points[0, 1] * _SCALE + 0.9
        speeds = "/".join(f"{speed:g}" for speed in dict.fromkeys(stroke.speed_mm_s.tolist()))
        text = f"{stroke.number}: {speeds} mm/s"
        text += " slow, fast, slow" if stroke.role == "step" else f", flow {stroke.flow:g}"
        yield f'<text class="small" x="{right:g}" y="{v:.2f}">{text}</text>'
    for one in pattern.questions:
        if pattern.name == "comb":
            v = -one.lines[:, :, 1].mean() * _SCALE + 0.9
            text = f"{one.number}: {one.value:g} mm"
            yield f'<text class="small" x="{right:g}" y="{v:.2f}">{text}</text>'
        else:
            joint = pattern.name == "joint"
            strokes = pattern.of_role("branch", "bridge")
            stroke = next(s for s in strokes if s.number == one.number)
            u, v = _place(stroke.points[0 if joint else -1].tolist())
            unit = "radii" if joint else "mm"
            at = (u - 3, v - 3) if joint else (u + 4, v + 0.9)
            text = f"{one.number}: {one.value:g} {unit}"
            yield f'<text class="small" x="{at[0]:.2f}" y="{at[1]:.2f}">{text}</text>'


def _scales(pattern: Pattern) -> Iterator[str]:
    if not pattern.of_role("frame"):
        return
    x, y = pattern.size_mm
    yield f'<text x="0" y="6">frame {x:.3f} mm along x (middle of the ink)</text>'
    yield f'<text x="-4" y="0" transform="rotate(-90 -4 0)">{y:.3f} mm along y</text>'


def _legend(written: WrittenPattern) -> Iterator[str]:
    pattern, mounted = written.pattern, written.mounted
    bead = pattern.bead
    what = "filament" if bead.round_bead else f"line {bead.layer_mm:g} mm high"
    yield f"printctl calibrate pattern {pattern.name}, no. {written.number}; drawn {_SCALE:g}:1"
    yield f"{what}, {bead.width_mm:g} mm wide at flow 1; dots: where each stroke begins"
    yield f"{mounted.ink}, needle {mounted.needle}, syringe {mounted.syringe}, {mounted.printer}"
    if pattern.of_role("frame"):
        yield "The frame is printed too: have all of it in the picture."
    else:
        yield f"{pattern.size_mm[0]:g} mm across; for printctl observe frame --printed."
