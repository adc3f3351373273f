"""Pass or fail, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Finding = tuple[bool, str]

_WAYS = ("leak", "bridge")


def verdict(
    registration: dict[str, Any], tolerance_um: float, diameter_tolerance_percent: float
) -> dict[str, Any]:
    """Judge a registration report.

    The print passes when every vessel was seen from end to end and is open, nothing leaks, no
    diameter is off by more than its tolerance, on the whole or in any one place, every vessel
    that should carry flow does, the pose is unambiguous, and the RMS deviation of the scaled fit
    (shrinkage taken out; the rigid fit stands beside it) is within the tolerance. What wasn't
    seen is never taken for good: the print then doesn't pass, and ``undecided`` says that it was
    for want of sight alone.

    Parameters
    ----------
    registration : dict
        Of registration.json. What an older one doesn't hold isn't judged.
    tolerance_um : float, µm
    diameter_tolerance_percent : float, %

    Returns
    -------
    dict
        ``passed``, ``undecided`` (bool), ``reasons`` (list of str).
    """
    seen_badly, openness = _openness(registration["vessels"])
    findings = [
        openness,
        *_leaks(registration),
        *_mean_errors(registration["vessels"], diameter_tolerance_percent),
        *_places(registration, diameter_tolerance_percent),
        *_flow(registration),
        _rms(registration, tolerance_um),
        _pose(registration),
    ]
    failed = [good for good, _ in findings if not good]
    return {
        "passed": not failed,
        "undecided": bool(failed) and len(failed) == 1 and seen_badly,
        "reasons": [text for _, text in findings],
    }


def _openness(vessels: Sequence[dict[str, Any]]) -> tuple[bool, Finding]:
    """Whether it is want of sight alone, and the finding."""
    closed = [row["vessel"] for row in vessels if row["open"] is False]
    unseen = [row["vessel"] for row in vessels if row["open"] is None]
    if not closed and not unseen:
        return False, (True, f"All {len(vessels)} vessels are open")
    said = []
    if closed:
        said.append(f"{len(closed)} of {len(vessels)} vessels not open: {_some(closed)}")
    if unseen:
        said.append(
            f"{len(unseen)} of {len(vessels)} vessels not seen from end to end, so neither open "
            f"nor closed: {_some(unseen)}"
        )
    return not closed, (False, "; ".join(said))


def _leaks(registration: dict[str, Any]) -> list[Finding]:
    if "defects" not in registration:
        return []
    found = [row for row in registration["defects"] if row["kind"] in _WAYS]
    if not found:
        return [(True, "No leak, and no bridge between vessels, was found")]
    worst = max(found, key=lambda row: row["size_um"])
    to = "the outside" if worst["other"] is None else f"vessel {worst['other']}"
    text = (
        f"{len(found)} leak{'s' if len(found) > 1 else ''} or bridge"
        f"{'s' if len(found) > 1 else ''}, the widest {worst['size_um']:.0f} µm from vessel "
        f"{worst['vessel']} ({worst['at_mm']:.1f} mm along) to {to}"
    )
    return [(False, text)]


def _mean_errors(vessels: Sequence[dict[str, Any]], limit: float) -> list[Finding]:
    measured = [row for row in vessels if row["error_percent"] is not None]
    if not measured:
        return []
    worst = max(measured, key=lambda row: abs(row["error_percent"]))
    beyond = sum(abs(row["error_percent"]) > limit for row in measured)
    text = (
        f"Largest diameter error {_signed(worst['error_percent'])} % of ±{limit:g} % allowed "
        f"(vessel {worst['vessel']}"
        + (f"; {beyond} of {len(measured)} vessels beyond)" if beyond else ")")
    )
    return [(beyond == 0, text)]


def _places(registration: dict[str, Any], limit: float) -> list[Finding]:
    """Bulges and stenoses, of which those beyond the diameter's tolerance count."""
    local = [row for row in registration.get("defects", ()) if row["kind"] in ("bulge", "stenosis")]
    if not local:
        return []
    worst = max(local, key=lambda row: abs(row["percent"]))
    beyond = sum(abs(row["percent"]) > limit for row in local)
    text = (
        f"{len(local)} local change{'s' if len(local) > 1 else ''} of diameter, {beyond} beyond "
        f"±{limit:g} %: at most {_signed(worst['percent'])} % ({worst['kind']} in vessel "
        f"{worst['vessel']}, {worst['at_mm']:.1f} mm along)"
    )
    return [(beyond == 0, text)]


def _flow(registration: dict[str, Any]) -> list[Finding]:
    flow = registration.get("perfusion")
    if not flow:
        return []
    starved = [row["vessel"] for row in flow["vessels"] if not row["fed"]]
    if starved:
        return [(False, f"{len(starved)} vessels carry no flow as printed: {_some(starved)}")]
    drop, designed = flow["pressure_drop_pa"], flow["designed_pressure_drop_pa"]
    if not drop or not designed:
        return []
    ratio = drop / designed
    shift = max(abs(row["share"] - row["designed_share"]) for row in flow["vessels"])
    text = (
        f"Every vessel is fed; the print needs {ratio:.2f} times the designed pressure, and no "
        f"vessel's share of the flow is off by more than {100 * shift:.1f} % of the whole"
    )
    return [(True, text)]


def _rms(registration: dict[str, Any], tolerance_um: float) -> Finding:
    rms, rigid = registration["scaled"]["rms_um"], registration["rigid"]["rms_um"]
    return (
        rms <= tolerance_um,
        f"RMS deviation {rms:.1f} µm of {tolerance_um:g} µm allowed (scaled fit; "
        f"{rigid:.1f} µm rigid)",
    )


def _pose(registration: dict[str, Any]) -> Finding:
    if registration["ambiguity"]["flag"]:
        doubts = registration["ambiguity"].get("doubts") or ["another one fits nearly as well"]
        return False, f"The pose is ambiguous: {doubts[0]}"
    return True, "The pose is unambiguous"


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "\N{MINUS SIGN}")


def _some(vessels: Sequence[int]) -> str:
    shown = ", ".join(map(str, vessels[:8]))
    return shown + (" …" if len(vessels) > 8 else "")
