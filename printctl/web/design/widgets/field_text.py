"""Convert between input text and a recipe value; labels, hints and placeholders of inputs."""

from __future__ import annotations

from typing import Any

import yaml

from firmware_profiles.yaml_file import read_yaml
from printctl.web.design.schema import FormField, Node


def parse_typed(node: Node, text: str) -> Any:
    """Parse typed text; what isn't a number stays text, and the check reports it."""
    text = text.strip()
    if node.sort == "number":
        return _number(text)
    if node.sort in ("list", "row", "free"):
        return _value(text, node.sort)
    return text


def input_text(node: Node, value: Any) -> str:
    """What an input shows of a value; empty for none."""
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, list | dict):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, allow_unicode=True).strip()
    return text[1:-1] if isinstance(value, list) and node.sort == "list" else text


def placeholder(field: FormField) -> str:
    """The default, or what to give."""
    if field.default is not None and field.default != [] and field.default != {}:
        return input_text(field.node, field.default)
    return "to be given" if field.required else "not given"


def hint(field: FormField) -> str:
    """Help and limits in a line."""
    parts = [field.help.rstrip("."), field.node.bounds and f"{field.node.bounds} {field.unit}"]
    return " · ".join(part.strip() for part in parts if part)


def label(field: FormField) -> str:
    """Name and unit."""
    words = field.label.split()
    tail = {
        "mm", "um", "s", "ul", "ml", "min", "mmhg", "percent", "degrees", "deg", "mpa", "pa", "kpa",
        "gb", "dyn", "cm2", "mm2", "millimolar",
    }  # fmt: skip
    while field.unit and len(words) > 1 and words[-1] in tail:
        words.pop()
    name = " ".join(words)
    return f"{name} ({field.unit})" if field.unit else name


def _number(text: str) -> Any:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text.replace("−", "-"))
    except ValueError:
        return text


def _value(text: str, sort: str) -> Any:
    bracketed = sort == "list" and not text.startswith("[")
    try:
        return read_yaml(f"[{text}]" if bracketed else text)
    except yaml.YAMLError:
        return text
