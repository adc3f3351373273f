"""List the measurement record (operator, instrument, certificate, temperature) as report facts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from registration.report.sections import Fact, mapping
from registration.report.wording import is_number, plain

NOT_STATED: Final = "not stated"
_LABELS: Final = {
    "part": "Part",
    "material": "Material",
    "operator": "Operator",
    "instrument": "Instrument",
    "serial": "Serial number",
    "certificate.number": "Certificate",
    "certificate.issued": "Certificate issued",
    "certificate.valid_until": "Certificate valid until",
    "certificate.by": "Certificate issued by",
    "scanned": "Time of the scan",
    "age_at_registration_h": "Age at registration",
    "temperature_c": "Temperature of bath or room",
    "temperature_range_c": "Temperature range stated",
    "corrected": "Corrected",
    "not_corrected": "Not corrected",
    "tolerance_source": "Source of the tolerances",
    "decision_rule": "Decision rule",
}
_UNITS: Final = {"age_at_registration_h": "h", "temperature_c": "°C", "temperature_range_c": "°C"}


def record_facts(registration: Mapping[str, Any]) -> list[Fact]:
    """Return every field of the record, "not stated" where it is missing; none without one."""
    record = mapping(registration, "record")
    if not record:
        return []
    return [_fact(record, key, label) for key, label in _LABELS.items()]


def _fact(record: Mapping[str, Any], key: str, label: str) -> Fact:
    outer, _, inner = key.partition(".")
    value = mapping(record, outer).get(inner) if inner else record.get(outer)
    if key in ("corrected", "not_corrected"):
        return Fact(label, "; ".join(value or []) or "nothing")
    if value is None:
        return Fact(label, NOT_STATED)
    if key == "temperature_range_c":
        return Fact(label, f"{value[0]:g} to {value[1]:g}", "°C")
    return Fact(label, f"{value:g}" if is_number(value) else plain(value), _UNITS.get(key, ""))
