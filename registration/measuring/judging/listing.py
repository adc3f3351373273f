"""List a registration's findings; if it wasn't judged, its defects instead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Record = Mapping[str, Any]


def list_findings(numbers: Record) -> Sequence[Record]:
    """Return all findings of a registration; the defects of one that wasn't judged."""
    findings = numbers.get("findings", numbers.get("defects", ()))
    return findings if isinstance(findings, Sequence) else ()
