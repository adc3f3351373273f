"""Draw a calibration pattern with numbered lines (SVG), for use beside dish or microscope."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Final

from printctl.calibration.patterns.files import WrittenPattern
from printctl.calibration.patterns.plan import Pattern, Stroke

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
