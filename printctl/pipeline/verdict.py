"""Pass or fail, and why."""

from __future__ import annotations

from typing import Any

DIAMETER_TOLERANCE_PERCENT = 10.0


def verdict(registration: dict[str, Any], tolerance_um: float) -> dict[str, Any]:
    """Judge a registration report.

    The print passes when every vessel is open, no diameter is off by more than a tenth, the pose
    is unambiguous, and the RMS deviation of the scaled fit (shrinkage taken out; the rigid fit
    stands beside it) is within the tolerance.
    """
    vessels = registration["vessels"]
    closed = [row["vessel"] for row in vessels if not row["open"]]
    measured = [row for row in vessels if row["error_percent"] is not None]
    worst = max(measured, key=lambda row: abs(row["error_percent"]), default=None)
    rms = registration["scaled"]["rms_um"]
    findings = [
        (
            not closed,
            f"all {len(vessels)} vessels are open"
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
            "the pose is ambiguous: another one fits nearly as well"
            if registration["ambiguity"]["flag"]
            else "the pose is unambiguous",
        ),
    ]
    if worst is not None:
        error = worst["error_percent"]
        findings.insert(
            1,
            (
                abs(error) <= DIAMETER_TOLERANCE_PERCENT,
                f"largest diameter error {error:+.1f} % of ±{DIAMETER_TOLERANCE_PERCENT:g} % "
                f"allowed (vessel {worst['vessel']})",
            ),
        )
    return {
        "passed": all(good for good, _ in findings),
        "reasons": [text for _, text in findings],
    }


def _some(vessels: list[int]) -> str:
    shown = ", ".join(map(str, vessels[:8]))
    return shown + (" …" if len(vessels) > 8 else "")
