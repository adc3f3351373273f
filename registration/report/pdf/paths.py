"""Parse SVG styles and transforms, and trace SVG paths onto the PDF canvas."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Final

Matrix = tuple[float, float, float, float, float, float]

_TOKEN: Final = re.compile(r"[MLCQHVZmlcqhvz]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_CALL: Final = re.compile(r"(\w+)\s*\(([^)]*)\)")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_TAKES: Final = {"M": 2, "L": 2, "Q": 4, "C": 6, "H": 1, "V": 1}
_INHERITED: Final = (
    "fill", "stroke", "stroke-width", "stroke-linejoin", "stroke-linecap", "stroke-dasharray",
    "stroke-dashoffset", "fill-opacity", "stroke-opacity", "font-size", "font-weight", "font",
    "text-anchor",
)  # fmt: skip

Style = dict[str, str]
START: Final[Style] = {
    "fill": "#000000", "stroke": "none", "stroke-width": "1", "stroke-linejoin": "round",
    "stroke-linecap": "butt", "stroke-dasharray": "none", "text-anchor": "start",
}  # fmt: skip
"""As matplotlib's own style sheet begins."""


def styled(attributes: Mapping[str, str], above: Style) -> Style:
    """An element's style: its own over what it inherits; opacity multiplies."""
    own = {name: attributes[name] for name in (*_INHERITED, "opacity") if name in attributes}
    for part in attributes.get("style", "").split(";"):
        name, colon, value = part.partition(":")
        if colon:
            own[name.strip()] = value.strip()
    opacity = float(above.get("opacity", 1)) * float(own.pop("opacity", 1))
    inherited = {name: value for name, value in above.items() if name in _INHERITED}
    return {**inherited, **own, "opacity": str(opacity)}


def numbers(words: str) -> list[float]:
    """All numbers in a text."""
    return [float(text) for text in _NUMBER.findall(words)]


def matrices(transform: str) -> list[Matrix]:
    """The matrices of a transform attribute, outermost first."""
    return [_matrix(name, numbers(values)) for name, values in _CALL.findall(transform)]


def _matrix(name: str, v: list[float]) -> Matrix:
    if name == "matrix":
        return (v[0], v[1], v[2], v[3], v[4], v[5])
    if name == "translate":
        return (1, 0, 0, 1, v[0], v[1] if len(v) > 1 else 0)
    if name == "scale":
        return (v[0], 0, 0, v[-1], 0, 0)
    if name == "rotate":
        c, s = math.cos(math.radians(v[0])), math.sin(math.radians(v[0]))
        x, y = (v[1], v[2]) if len(v) > 2 else (0.0, 0.0)
        return (c, s, -s, c, x - c * x + s * y, y - s * x - c * y)
    raise ValueError(f"transform {name} of a drawing isn't known")


def trace(path: Any, outline: str) -> None:
    """Draw the outline of an SVG path (absolute M, L, H, V, Q, C, Z) into a canvas's path."""
    tokens = _TOKEN.findall(outline)
    at, command, x, y = 0, "M", 0.0, 0.0
    while at < len(tokens):
        if tokens[at].isalpha():
            command, at = tokens[at].upper(), at + 1
            if command == "Z":
                path.close()
                continue
        v = [float(token) for token in tokens[at : at + _TAKES[command]]]
        at += _TAKES[command]
        if command == "Q":  # a cubic with the same course
            a, b = (x + 2 * (v[0] - x) / 3, y + 2 * (v[1] - y) / 3), (v[2], v[3])
            v = [*a, b[0] + 2 * (v[0] - b[0]) / 3, b[1] + 2 * (v[1] - b[1]) / 3, *b]
        elif command in "HV":
            v = [v[0], y] if command == "H" else [x, v[0]]
        x, y = v[-2:]
        if command == "M":
            path.moveTo(x, y)
            command = "L"  # what follows without a letter
        elif len(v) == 6:
            path.curveTo(*v)
        else:
            path.lineTo(x, y)
