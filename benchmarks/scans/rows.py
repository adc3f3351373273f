"""Summary rows of issue 22's table, from result lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.common import Row, row
from benchmarks.scans.cases import TOLERANCE_PERCENT

Line = dict[str, Any]


def percent(hits: float, of: float) -> float:
    """Return a share in percent; NaN of nothing."""
    return round(100 * hits / of, 2) if of else float("nan")


def counted(rows: list[bool]) -> str:
    """Return "3 of 7"."""
    return f"{sum(rows)} of {len(rows)}"


def changes(lines: list[Line]) -> Iterator[Row]:
    """Return what was found, what passed, false alarms."""
    planted = [p for x in lines for p in x["judged"]["defects"]["planted"]]
    beyond = [
        p["found"] for p in planted if abs(p["true_worst_percent"] or 0) > TOLERANCE_PERCENT + 2
    ]
    yield row(
        f"changes beyond tolerance and 2 % found ({counted(beyond)})",
        percent(sum(beyond), len(beyond)),
        "%",
        ">= 98",
        percent(sum(beyond), len(beyond)) >= 98,
    )
    passes = sum(x["judged"]["verdict"]["false_pass"] for x in lines)
    yield row(
        f"passes with a true section beyond 1.5 x tolerance, {len(lines)} scans",
        passes,
        "",
        "0",
        passes == 0,
    )
    clean = sum(x["judged"]["defects"]["clean_vessels"] for x in lines)
    alarms = sum(x["judged"]["defects"]["false_alarm_vessels"] for x in lines)
    yield row(
        f"false alarms, {alarms} of {clean} clean vessels",
        percent(alarms, clean),
        "%",
        "<= 1",
        percent(alarms, clean) <= 1,
    )


def poses(lines: list[Line]) -> Iterator[Row]:
    """Return poses landed, flagged and silently wrong."""
    pose = [x["judged"]["pose"] for x in lines]
    wrong = [p["silently_wrong"] for p in pose]
    fine = [p["landed"] or p["flagged"] for p in pose]
    yield row(
        f"poses landed or flagged ({counted(fine)})",
        percent(sum(fine), len(fine)),
        "%",
        ">= 99",
        percent(sum(fine), len(fine)) >= 99,
    )
    yield row(f"poses silently wrong ({counted(wrong)})", sum(wrong), "", "0", not any(wrong))
    passes = sum(x["judged"]["verdict"]["false_pass"] for x in lines)
    yield row("passes of half a part or a wrong one", passes, "", "0", passes == 0)


def intervals(lines: list[Line]) -> Iterator[Row]:
    """Return coverage and width of each kind of interval."""
    every = [q for x in lines for q in x["judged"]["quantities"]]
    for name in sorted({q["quantity"] for q in every}):
        own = [q for q in every if q["quantity"] == name]
        claimed = [q for q in own if q["holds"] is not None]
        error = np.array([q["error"] for q in own])
        unit = "%" if name[:5] in ("scale", "resis", "press") else "um"
        yield row(
            f"{name}: error, rms (bias {error.mean():.3g}, sd {error.std():.3g}; {len(own)})",
            float(np.sqrt((error**2).mean())),
            unit,
        )
        if claimed:
            held = percent(sum(q["holds"] for q in claimed), len(claimed))
            yield row(
                f"{name}: 95 % intervals hold the truth ({len(claimed)})",
                held,
                "%",
                "92 to 98",
                92 <= held <= 98,
            )
            width = float(np.median([2 * q["half"] for q in claimed])) / max(
                float(error.std()), 1e-12
            )
            yield row(f"{name}: median width over the errors' sd", width, "", "<= 5", width <= 5)
        else:
            yield row(f"{name}: 95 % intervals claimed", 0, "", ">= 300 of all kinds", False)


def ways(lines: list[Line]) -> Iterator[Row]:
    """Return leaks, bridges, plugs and missing vessels found, and their places."""
    planted = [p for x in lines for p in x["judged"]["defects"]["planted"]]
    for kind in ("leak", "bridge", "occlusion", "missing", ""):
        own = [p for p in planted if not kind or p["kind"] == kind]
        hits = [p["found"] for p in own]
        if own:
            share = percent(sum(hits), len(hits))
            yield row(
                f"{kind or 'all ways'} found ({counted(hits)})", share, "%", ">= 95", share >= 95
            )
    near = [
        p["place_mm"] <= 0.2
        for p in planted
        if p["place_mm"] is not None and p["kind"] != "missing"
    ]
    if near:
        yield row(
            f"place within 0.2 mm ({counted(near)})",
            percent(sum(near), len(near)),
            "%",
            "100",
            all(near),
        )
    wide = [p for p in planted if "width_holds" in p]
    if wide:
        error = np.array([p["width_error_um"] for p in wide])
        held = [p["width_holds"] for p in wide]
        yield row(f"width of leaks and bridges, bias (sd {error.std():.3g})", error.mean(), "um")
        share = percent(sum(held), len(held))
        yield row(
            f"their 95 % intervals hold ({counted(held)})",
            share,
            "%",
            "92 to 98",
            92 <= share <= 98,
        )
    false = sum(len(x["judged"]["defects"]["false"]) for x in lines)
    yield row(f"false defects listed beside them, {len(lines)} scans", false, "", "0", false == 0)


def diameters(lines: list[Line]) -> Iterator[Row]:
    """Return bias, spread, and the worst vessel's mean."""
    every = [q for x in lines for q in x["judged"]["quantities"]]
    error = np.array([q["error"] for q in every if q["quantity"] == "section"])
    means = np.array([q["error"] for q in every if q["quantity"] == "mean"])
    held = [q["holds"] for q in every if q["quantity"] == "mean"]
    inside = bool(held) and all(held)
    if len(error):
        yield row(
            f"diameter bias, {len(error)} sections",
            float(error.mean()),
            "um",
            "<= 5, or inside U",
            bool(abs(error.mean()) <= 5) or inside,
        )
        yield row("diameter rms error of sections", float(np.sqrt((error**2).mean())), "um")
        yield row(
            f"worst of {len(means)} vessels' means",
            float(np.abs(means).max()),
            "um",
            "<= 5, or inside U",
            bool(np.abs(means).max() <= 5) or inside,
        )


def faces(lines: list[Line]) -> Iterator[Row]:
    """Return how far faces called seen are off."""
    seen = [f for x in lines for f in x["judged"]["faces"] if f["seen"]]
    if seen:
        worst = [f["worst_um"] for f in seen]
        far = [w > 50 for w in worst]
        yield row(
            f"worst patch of a face called seen ({counted(far)} faces beyond 50 um)",
            max(worst),
            "um",
            "<= 50",
            max(worst) <= 50,
        )
        single = [f["beyond_percent"] for f in seen]
        yield row("points of a face called seen beyond 50 um, worst face", max(single), "%")
        middle = [abs(f["median_um"]) for f in seen]
        yield row("median of a face, worst", max(middle), "um", "<= 50", max(middle) <= 50)


def formats(lines: list[Line]) -> Iterator[Row]:
    """Return poses and false findings by stored form."""
    for x in lines:
        form = " ".join(x["case"]["options"])
        wrong = not (x["judged"]["pose"]["landed"] or x["judged"]["pose"]["flagged"])
        false = len(x["judged"]["defects"]["false"]) + x["judged"]["defects"]["false_alarm_vessels"]
        yield row(
            f"{form}: TRE rms; false findings {false}",
            x["judged"]["pose"]["tre_rms_um"],
            "um",
            "landed or flagged, none false",
            not wrong and not false,
        )


def time(lines: list[Line]) -> Iterator[Row]:
    """Return time and memory."""
    for x in lines:
        ran = x["ran"]
        yield row(
            f"1000 x 500 x 250 voxels to report (CPU {ran['cpu_s']:.1f} s)",
            ran["wall_s"],
            "s",
            "<= 8 on quiet cores",
            ran["wall_s"] <= 8,
        )
        yield row("the same, peak memory", ran["peak_mb"], "MB", "<= 1200", ran["peak_mb"] <= 1200)


ROWS: dict[str, Callable[[list[Line]], Iterator[Row]]] = {
    f.__name__: f for f in (changes, poses, intervals, ways, diameters, faces, formats, time)
}


def rows_of(family: str, lines: list[Line]) -> list[Row]:
    """Return a family's rows, each generator's by itself, and how many scans were refused."""
    out = []
    for generator in ("shared", "spectral"):
        own = [x for x in lines if x["family"] == family and x["case"]["generator"] == generator]
        judged = [x for x in own if x["judged"]]
        if own:
            head = {"family": family, "generator": generator}
            refused = row(f"refused, of {len(own)}", len(own) - len(judged), "")
            out += [head | r for r in [*(ROWS[family](judged) if judged else []), refused]]
    return out
