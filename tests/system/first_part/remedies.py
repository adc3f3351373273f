"""Remedies that a message proposes, as changes of the recipe, taken literally."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import yaml

Recipe = dict[str, Any]

SECTIONS = {
    "vasculature": (
        "root_mm", "root_direction", "root", "terminals", "smallest_diameter_mm", "clearance_mm",
        "overlaps", "printable", "inlets", "curves", "pressure_drop_mmhg",
    ),
    "toolpath": (
        "method", "needle", "layer_um", "line_um", "thinnest_layer_um", "stair_um", "overlap_radii",
        "allowed_crossings", "open_joints", "leave_out", "thinnest_bore", "walls",
        "write_speed_mm_s", "travel_speed_mm_s", "widest_filament_mm",
    ),
    "printer": ("ink", "bath", "dish", "syringe", "place_mm", "bath_depth_mm", "profile"),
    "scan": ("simulated", "voxel_um", "shrink_percent", "seed", "large"),
    "registration": (
        "tolerance_um", "diameter_tolerance_percent", "decision_rule", "conformance_percent",
    ),
    "tissue": ("size_limits_mm", "unit", "margin_mm"),
    "solid": ("fiducials", "fillet_ratio"),
}  # fmt: skip

SECTION_OF = {key: section for section, keys in SECTIONS.items() for key in keys}
NUMBER = r"[-+−]?\d+(?:\.\d+)?"
FILLER = r"(?:to|of|is|at|least|most|about|or|more|be|say|like|and|by|in|on|for)\b"
VALUE = rf"(\[[^\]]*\]|\{{[^}}]*\}}|{NUMBER}(?:\s*,\s*{NUMBER})*(?!\w)"
VALUE += rf"|(?!{FILLER})[a-z0-9][a-z0-9_]*)"


@dataclass(frozen=True)
class Remedy:
    """A change of the recipe, and the words that ask for it."""

    words: str
    change: Callable[[Recipe], None]

    def on(self, recipe: Recipe) -> Recipe:
        """Return a copy of the recipe with the change."""
        changed = copy.deepcopy(recipe)
        self.change(changed)
        return changed


def proposed(text: str) -> list[Remedy]:
    """Return all remedies in a message, each one alone and all together."""
    found: dict[str, Remedy] = {}
    for match in re.finditer(rf"\b({'|'.join(SECTIONS)}): (\{{[^}}]*\}})", text):
        keys = _value(match.group(2))
        if isinstance(keys, dict):
            found[match.group(0)] = Remedy(match.group(0), _merge(match.group(1), keys))
            text = text.replace(match.group(0), "")
    for key, section in SECTION_OF.items():
        name = rf"(?<![\w.])(?:{section}[.:]\s*\{{?)?{key}(?![\w])`?"
        pattern = rf"{name}(?:\s*[:=])?(?:\s+{FILLER})*\s*`?{VALUE}"
        for match in re.finditer(pattern, text):
            value = _value(match.group(1))
            explicit = re.search(rf"{key}`?\s*[:=]", match.group(0)) is not None
            if value is None or (isinstance(value, str) and not explicit):
                continue
            found[match.group(0)] = Remedy(match.group(0), _set(section, key, value))
    for pattern, change in VAGUE:
        vague = re.search(pattern, text)
        if vague:
            found[vague.group(0)] = Remedy(vague.group(0), change(vague))
    single = list(found.values())
    return single if len(single) < 2 else [*single, _together(single)]


def _together(remedies: list[Remedy]) -> Remedy:
    def change(recipe: Recipe) -> None:
        for one in remedies:
            one.change(recipe)

    return Remedy("all together", change)


def _value(text: str) -> Any:
    text = text.replace("−", "-")
    if re.fullmatch(rf"{NUMBER}(?:\s*,\s*{NUMBER})+", text):
        return [float(one) for one in text.split(",")]
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return None


def _merge(section: str, keys: Recipe) -> Callable[[Recipe], None]:
    return lambda recipe: recipe.setdefault(section, {}).update(keys)


def _set(section: str, key: str, value: Any) -> Callable[[Recipe], None]:
    def change(recipe: Recipe) -> None:
        part = recipe.setdefault(section, {})
        old = part.get(key)
        part[key] = [value] * 3 if key == "voxel_um" and not isinstance(value, list) else value
        if isinstance(old, int) and isinstance(value, float) and value == int(value):
            part[key] = int(value)

    return change


def _scaled(section: str, key: str, factor: float, default: float) -> Callable[[Recipe], None]:
    def change(recipe: Recipe) -> None:
        part = recipe.setdefault(section, {})
        part[key] = round(factor * part.get(key, default), 4)

    return change


def _microct(recipe: Recipe) -> None:
    recipe["scan"] = {"simulated": "microct"}


VAGUE: tuple[tuple[str, Callable[[re.Match[str]], Callable[[Recipe], None]]], ...] = (
    (r"[Ff]iner lines", lambda _: _scaled("toolpath", "line_um", 0.8, 150)),
    (r"[Ww]ider lumens", lambda _: _scaled("vasculature", "smallest_diameter_mm", 1.3, 0.4)),
    (
        r"only (\d+) of \d+ terminals(?=[^\n]*fewer)",
        lambda m: _set("vasculature", "terminals", int(m.group(1))),
    ),
    (
        r"[Ss]maller `?smallest_diameter_mm",
        lambda _: _scaled("vasculature", "smallest_diameter_mm", 0.8, 0.4),
    ),
    (
        r"[Ss]maller `?clearance(?:_mm)?",
        lambda _: _scaled("vasculature", "clearance_mm", 0.7, 0.1),
    ),
    (
        r"voxels? of (?:at most )?(\d+(?:\.\d+)?) ?(?:µm|um)(?! make one)",
        lambda m: _set("scan", "voxel_um", float(m.group(1))),
    ),
    (
        r"(?:[Ss]can (?:it )?(?:with|by|in)|[Uu]se|try|take|[;:.] ?) ?micro-?CT"
        r"|[Mm]icro-CT (?:sees|reaches|shows)",
        lambda _: _microct,
    ),
)
"""Words without a key, and what a user would do."""
