"""Provenance section of the PDF: recipe, scan, print, software versions, file hashes."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from registration.report.sections import Fact, facts, mapping
from registration.report.wording import MISSING, is_number, plain


def printed_on(data: Mapping[str, Any]) -> str | None:
    """Day and time of the print, UTC; None where no journal told it."""
    started = mapping(data, "printed").get("started")
    if not is_number(started):
        return None
    return datetime.fromtimestamp(started, UTC).strftime("%Y-%m-%d %H:%M UTC")


def origin_facts(data: Mapping[str, Any]) -> list[Fact]:
    """Recipe, print and scan."""
    printed, made = mapping(data, "printed"), mapping(data, "print")
    rows = [
        Fact("Name", plain(data.get("recipe", ""))),
        Fact("Printed", printed_on(data) or "not known"),
    ]
    rows += [Fact("Print", plain(printed["id"]))] if printed.get("id") else []
    rows += [Fact("Printer", plain(made["printer"]))] if made.get("printer") else []
    gauged = mapping(mapping(data, "registration"), "measured_by")
    scanned = facts({**gauged, **mapping(data, "scan")}, skip=("defects",))
    return rows + [Fact(f"Scan: {f.label}", f.value, f.unit) for f in scanned]


def digest_facts(data: Mapping[str, Any]) -> list[Fact]:
    """Versions, seed and SHA-256 of what went in."""
    provenance, printed = mapping(data, "provenance"), mapping(data, "printed")
    design = mapping(mapping(data, "registration"), "design")
    rows = [
        Fact(label, ", ".join(f"{name} {plain(v)}" for name, v in mapping(provenance, key).items()))
        for key, label in (("versions", "Versions"), ("machine", "Machine"))
        if mapping(provenance, key)
    ]
    rows += [Fact("Seed", plain(provenance["seed"]))] if "seed" in provenance else []
    digests = {
        "network.csv": design.get("network_sha256"),
        "G-code": printed.get("gcode_sha256"),
        **mapping(provenance, "inputs"),
    }
    return rows + [
        Fact(f"SHA-256 of {name}", plain(value)) for name, value in digests.items() if value
    ]


def meta_line(data: Mapping[str, Any]) -> str:
    """A few words below the name: scan, printer, day of the print."""
    said = [
        f"Scan: {plain(mapping(data, 'scan').get('source') or MISSING)}",
        plain(mapping(data, "print").get("printer") or ""),
        f"printed {printed_on(data)}" if printed_on(data) else "",
    ]
    return "   ·   ".join(words for words in said if words not in ("", MISSING))
