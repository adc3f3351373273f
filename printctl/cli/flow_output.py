"""Data class of `printctl flow` results: numbers of each fidelity, and written files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass
class FlowOutput:
    """What is said at the end: numbers, those of other fidelities in dicts, and files."""

    summary: dict[str, Any] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)
