"""Judge reported defects and verdict against planted defects and true sections."""

from __future__ import annotations

import numpy as np

from benchmarks.common import Row
from benchmarks.scans.judge_pose import apply

OPENING = ("leak", "bridge")
BROKEN = ("occlusion", "missing", "leak", "bridge")
MATCHING = {
    "stenosis": ("stenosis", "occlusion"),
    "narrowed": ("stenosis", "narrowed"),
    "bulge": ("bulge",),
    "widened": ("bulge", "widened"),
    "leak": OPENING,
    "bridge": OPENING,
    "occlusion": ("occlusion", "missing", "stenosis"),
    "missing": ("missing", "occlusion"),
}


def true_at(section: Row, along: np.ndarray, rough: bool = False) -> np.ndarray:
    """Return true diameters (um) at places; NaN near junctions and out of view.

    `rough`: of the walls as they are, where the truth has that; else of smooth ones.
    """
    usable = np.array(section["clear"]) & np.array(section["in_view"])
    known = section["diameter_um"]
    if rough:
        known = section.get("rough_diameter_um", known)
    value = np.where(usable, [np.nan if d is None else d for d in known], np.nan)
    return np.asarray(np.interp(along, section["along_mm"], value, left=np.nan, right=np.nan))


def true_errors(section: Row) -> np.ndarray:
    """Return the known true errors of a vessel's sections, percent of the design."""
    real = true_at(section, np.array(section["along_mm"]))
    error = 100 * (real / np.array(section["designed_um"]) - 1)
    return np.asarray(error[np.isfinite(error)])


def visible(planted: Row, truth: Row) -> bool:
    """Whether a planted defect's place is in view."""
    section = truth["vessels"][planted["vessel"]]
    return bool(
        np.interp(planted["at_mm"], section["along_mm"], np.array(section["in_view"], float)) > 0.5
    )


def place_error(planted: Row, listed: Row, truth: Row, turn: np.ndarray) -> float:
    """Return the distance (mm) of a listed defect from the planted one."""
    out = np.inf
    if listed.get("point_mm"):
        there = apply(turn, np.array([listed["point_mm"]]))[0]
        out = float(np.linalg.norm(there - planted["center_mm"]))
    if (
        listed.get("at_mm") is not None
        and listed["vessel"] == planted["vessel"]
        and np.allclose(turn, np.eye(4))
    ):
        below, above = planted["from_mm"] - listed["at_mm"], listed["at_mm"] - planted["to_mm"]
        out = min(out, max(below, above, 0.0))
    return out


def is_found(planted: Row, listed: Row, reach: float, truth: Row, turn: np.ndarray) -> bool:
    """Whether a listed defect is the planted one by kind and place."""
    if listed["kind"] not in MATCHING.get(planted["kind"], (planted["kind"],)):
        return False
    same_vessel = listed["vessel"] == planted["vessel"] or not np.allclose(turn, np.eye(4))
    if planted.get("whole_vessel") or planted["kind"] == "missing":
        return bool(same_vessel)
    return place_error(planted, listed, truth, turn) <= reach


def judge_defects(
    report: Row, truth: Row, turn: np.ndarray, tolerance: float, reach: float = 0.7
) -> Row:
    """Return what was planted, found, missed, and listed falsely.

    A change of a whole vessel counts as found too where the vessel's mean is beyond tolerance.
    """
    listed = report.get("defects") or []
    off = {r["vessel"] for r in report["vessels"] if abs(r.get("error_percent") or 0) > tolerance}
    rows = []
    for planted in truth["defects"]:
        if not visible(planted, truth):
            continue
        hits = [d for d in listed if is_found(planted, d, reach, truth, turn)]
        by_mean = bool(planted.get("whole_vessel")) and planted["vessel"] in off
        place = min((place_error(planted, d, truth, turn) for d in hits), default=None)
        kept = {
            k: planted[k]
            for k in ("kind", "vessel", "percent", "diameter_um", "length_um", "sigma_mm")
            if k in planted
        }
        worst = true_errors(truth["vessels"][planted["vessel"]])
        kept["true_worst_percent"] = (
            round(float(worst[np.abs(worst).argmax()]), 2) if len(worst) else None
        )
        kept |= judge_width(planted, hits, truth)
        rows.append(kept | {"found": bool(hits) or by_mean, "place_mm": place})
    false = [
        d for d in listed if not any(is_found(p, d, 1.0, truth, turn) for p in truth["defects"])
    ]
    touched = {p["vessel"] for p in truth["defects"]} | {p.get("other") for p in truth["defects"]}
    clean = [v["vessel"] for v in truth["vessels"] if v["vessel"] not in touched]
    fine = [
        v for v in clean if np.abs(true_errors(truth["vessels"][v])).max(initial=0) < tolerance - 1
    ]
    alarms = {d["vessel"] for d in false if d["vessel"] in fine} | {v for v in off if v in fine}
    return {
        "planted": rows,
        "false": [f"{d['kind']} in vessel {d['vessel']}" for d in false],
        "clean_vessels": len(fine),
        "false_alarm_vessels": len(alarms),
    }


def judge_width(planted: Row, hits: list[Row], truth: Row) -> Row:
    """Return the error of a leak's or bridge's width and whether its interval holds, as printed.

    The part's scales are taken by their geometric mean.
    """
    if planted["kind"] not in OPENING or not hits:
        return {}
    best = max(hits, key=lambda d: d.get("size_um") or 0.0)
    if best.get("size_um") is None or best.get("error_um") is None:
        return {}
    error = best["size_um"] - planted["diameter_um"] * float(np.prod(truth["scale"])) ** (1 / 3)
    return {"width_error_um": error, "width_holds": bool(abs(error) <= best["error_um"])}


def judge_verdict(whole: Row, truth: Row, tolerance: float, guard: float = 1.5) -> Row:
    """Return the verdict and whether it passes what mustn't pass.

    bad: broken, or a section beyond the tolerance and 1 %. `false_pass`: passes though a section is
    beyond `guard` times the tolerance, a vessel is broken, or not all is in view.
    """
    said = whole["verdict"]
    word = "passed" if said["passed"] else "undecided" if said["undecided"] else "failed"
    worst = max((np.abs(true_errors(v)).max(initial=0) for v in truth["vessels"]), default=0.0)
    broken = any(d["kind"] in BROKEN and visible(d, truth) for d in truth["defects"])
    bad = broken or worst > tolerance + 1
    false_pass = word == "passed" and (
        broken or worst > guard * tolerance or not truth["whole_in_view"]
    )
    good = not bad and worst < tolerance - 1 and truth["whole_in_view"]
    return {
        "verdict": word,
        "truth": "bad" if bad else "good" if good else "marginal",
        "worst_percent": float(worst),
        "false_pass": bool(false_pass),
    }
