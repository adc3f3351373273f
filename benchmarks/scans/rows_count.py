"""Summary rows of issue 22's overall count (`count`), for one scan generator."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.common import row
from benchmarks.scans.cases import TOLERANCE_PERCENT
from benchmarks.scans.rows import (
    Line,
    Row,
    counted,
    diameters,
    faces,
    intervals,
    percent,
    poses,
    ways,
)

SMOOTH_UM = 30.0
BROKEN = ("leak", "bridge", "occlusion", "missing")


def option(line: Line, name: str) -> float:
    """Return the number given by an option `--name=`."""
    found = [o.split("=")[1] for o in line["case"]["options"] if o.startswith(f"--{name}=")]
    return float(found[0]) if found else float("nan")


def broken(line: Line) -> bool:
    """Whether a leak, bridge, plug or missing vessel was planted."""
    return any(p["kind"] in BROKEN for p in line["judged"]["defects"]["planted"])


def count(lines: list[Line]) -> Iterator[Row]:
    """Return the table: changes, vessels, poses, intervals, ways, faces, diameters."""
    judged = [x for x in lines if x["judged"]]
    yield from refusals(lines)
    yield from changes(judged)
    yield from vessels([v for x in judged for v in x["judged"]["vessels"]])
    yield from poses(judged)
    yield from intervals(judged)
    yield from ways([x for x in judged if broken(x) and x["judged"]["pose"]["landed"]])
    yield from unlit([x for x in judged if broken(x) and not x["judged"]["pose"]["landed"]])
    yield from faces(judged)
    smooth = [x for x in judged if option(x, "roughness-um") <= SMOOTH_UM]
    yield from diameters(smooth)


def unlit(lines: list[Line]) -> Iterator[Row]:
    """Return whether a broken vessel passes where the light didn't carry a pose."""
    passed = [x["judged"]["verdict"]["verdict"] == "passed" for x in lines]
    name = f"passes of broken parts that didn't land ({counted(passed)})"
    yield row(name, sum(passed), "", "0", not any(passed))


def refusals(lines: list[Line]) -> Iterator[Row]:
    """Return which mirrored scans were refused or flagged, and what else was refused."""
    mirrored = [x for x in lines if "--mirror" in x["case"]["options"]]
    said = [not x["judged"] or x["judged"]["pose"]["flagged"] for x in mirrored]
    share = percent(sum(said), len(said))
    yield row(f"mirrored refused or flagged ({counted(said)})", share, "%", "100", all(said))
    other = [not x["judged"] for x in lines if x not in mirrored]
    yield row(f"other scans refused ({counted(other)})", sum(other), "")


def changes(lines: list[Line]) -> Iterator[Row]:
    """Return changes found that are truly beyond tolerance and the report's own U there."""
    passes = [x["judged"]["verdict"]["false_pass"] for x in lines]
    yield row(
        f"passes with a true section beyond 1.5 x tolerance ({counted(passes)})",
        sum(passes),
        "",
        "0",
        not any(passes),
    )
    good = [x["judged"]["verdict"] for x in lines if not x["judged"]["defects"]["planted"]]
    fine = [v["verdict"] == "passed" for v in good if v["truth"] == "good"]
    share = percent(sum(fine), len(fine))
    yield row(f"clean prints that pass at ± {TOLERANCE_PERCENT:g} % ({counted(fine)})", share, "%")
    found, near = [], []
    for x in lines:
        half = {v["vessel"]: v["u_percent"] for v in x["judged"]["vessels"]}
        for p in x["judged"]["defects"]["planted"]:
            if p["kind"] in BROKEN or half.get(p["vessel"]) is None:
                continue
            beyond = abs(p["true_worst_percent"] or 0) > TOLERANCE_PERCENT + half[p["vessel"]]
            (found if beyond else near).append(p["found"])
    share = percent(sum(found), len(found))
    yield row(
        f"changes beyond tolerance + U found ({counted(found)}); others ({counted(near)})",
        share,
        "%",
        ">= 98",
        share >= 98,
    )


def vessels(rows: list[dict[str, Any]]) -> Iterator[Row]:
    """Return decisions on sound and on bad vessels, and whether the list has what is plotted."""
    sound = [v for v in rows if not v["touched"] and v["worst_percent"] < TOLERANCE_PERCENT - 1]
    failed = [v["decision"] == "fail" for v in sound]
    share = percent(sum(failed), len(failed))
    yield row(f"sound vessels that fail ({counted(failed)})", share, "%", "<= 1", share <= 1)
    unsure = [v["decision"] == "undecided" for v in sound]
    yield row(
        f"sound vessels undecided ({counted(unsure)})", percent(sum(unsure), len(unsure)), "%"
    )
    guarded = sum(v["guarded"] for v in rows)
    yield row("vessels that pass beyond 1.5 x tolerance", guarded, "", "0", guarded == 0)
    hidden = sum(v["unlisted"] for v in rows)
    yield row("sections plotted outside their band and in no finding", hidden, "", "0", hidden == 0)


def rows_of_count(lines: list[Line]) -> list[Row]:
    """Return the rows of each generator, and of both."""
    own = [x for x in lines if x["family"] == "count"]
    out = []
    for name in ("shared", "spectral", "both"):
        some = [x for x in own if name in ("both", x["case"]["generator"])]
        if some:
            out += [{"family": "count", "generator": name} | r for r in count(some)]
    return out
