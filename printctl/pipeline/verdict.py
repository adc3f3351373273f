"""Pass or fail, and why."""

from __future__ import annotations

from typing import Any


def verdict(
    registration: dict[str, Any], tolerance_um: float, diameter_tolerance_percent: float
) -> dict[str, Any]:
    """Judge a registration report.

    The print passes when every vessel is open, no diameter is off by more than its tolerance, the
    pose is unambiguous, and the RMS deviation of the scaled fit (shrinkage taken out; the rigid
    fit stands beside it) is within the tolerance.
    """
    vessels = registration["vessels"]
    closed = [row["vessel"] for row in vessels if not row["open"]]
    measured = [row for row in vessels if row["error_percent"] is not None]
    worst = max(measured, key=lambda row: abs(row["error_percent"]), default=None)
    rms = registration["scaled"]["rms_um"]
    findings = [
        (
            not closed,
            f"All {len(vessels)} vessels are open"
            if not closed
            else f"{len(closed)} of {len(vessels)} vessels not open: {_some(closed)}",
        ),
        (
            rms <= tolerance_um,
            f"RMS deviation {rms:.1f} µm of {tolerance_um:g} µm allowed (scaled fit; "
            f"{registration['rigid']['rms_um']:.1f} µm rigid)",
        ),
        (
            not registration["ambiguity"]["flag"],
            "The pose is ambiguous: another one fits nearly as well"
            if registration["ambiguity"]["flag"]
            else "The pose is unambiguous",
        ),
    ]
    if worst is not None:
        error = worst["error_percent"]
        limit = diameter_tolerance_percent
        beyond = sum(abs(row["error_percent"]) > limit for row in measured)
        findings.insert(
            1,
            (
                beyond == 0,
                f"Largest diameter error {_signed(error)} % of ±{limit:g} % allowed "
                f"(vessel {worst['vessel']}"
                + (f"; {beyond} of {len(measured)} vessels beyond)" if beyond else ")"),
            ),
        )
    return {
        "passed": all(good for good, _ in findings),
        "reasons": [text for _, text in findings],
    }


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "\N{MINUS SIGN}")


def _some(vessels: list[int]) -> str:
    shown = ", ".join(map(str, vessels[:8]))
    return shown + (" …" if len(vessels) > 8 else "")
