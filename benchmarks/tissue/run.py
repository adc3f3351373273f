"""Grow a tree in each of three hundred tissues; count what went wrong, by a judge of its own.

Parts come from how a tissue was made. `welded_volumes` finds them once more from the faces, for
tissues whose parts don't touch and whose file isn't spoilt: a test compares the two.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers import outlet_flows, read_network, write_stl
from benchmarks.common import ROOT, Row, limited, scratch
from benchmarks.tissue.cases import KINDS, SEEDS, Case, make, true_volume
from benchmarks.tissue.solids import FloatArray, IntArray, Solid, groups, volume_of

SHARE_OFF = 0.05
"""Of the whole flow: how far a part's share may be from its share of the volume."""

LOBE_EXPECTS = 6
"""Terminals that a lobe's volume asks for, from which on none is too few."""

_RAYS = np.array([[0.577, 0.214, 0.788], [-0.318, 0.871, 0.374], [0.149, -0.528, 0.836]])


def welded_volumes(solid: Solid) -> list[float]:
    """Volumes of what hangs together once equal vertices are one, mm³, largest first."""
    points, number = np.unique(solid.points.astype(np.float32), axis=0, return_inverse=True)
    faces = number.reshape(-1)[solid.faces]
    group = groups(len(points), faces)[faces[:, 0]]
    own = [Solid(points.astype(np.float64), faces[group == n]) for n in np.unique(group)]
    return sorted(map(volume_of, own), reverse=True)


def inside(solids: tuple[Solid, ...], points: FloatArray) -> NDArray[np.bool_]:
    """Which points lie in any of the solids: most of three rays cross its surface oddly often."""
    found = np.zeros(len(points), dtype=bool)
    for solid in solids:
        corners = solid.points[solid.faces]
        odd = [_crossed(corners, points, ray) % 2 for ray in _RAYS]
        found |= np.sum(odd, axis=0) >= 2
    return found


def _crossed(corners: FloatArray, points: FloatArray, ray: FloatArray) -> IntArray:
    """How many triangles a ray from each point passes (Möller & Trumbore 1997)."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(ray, two)
    scale = (one * across).sum(axis=1)
    good = np.abs(scale) > 1e-300
    scale = np.where(good, scale, 1.0)
    count = np.zeros(len(points), dtype=np.int64)
    for k, point in enumerate(points):
        away = point - corners[:, 0]
        u = (away * across).sum(axis=1) / scale
        turned = np.cross(away, one)
        v = turned @ ray / scale
        t = (two * turned).sum(axis=1) / scale
        count[k] = (good & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).sum()
    return count


def verdict(
    volumes: FloatArray, number: IntArray, flow: FloatArray, lobes: bool, told: str
) -> dict[str, Any]:
    """Judge a grown tissue by the true volumes (p,) of its parts, or of the lobes of one.

    ``number`` (t,): part of each terminal, -1 for none; ``flow`` (t,): solved by the judge, all
    inlets at one pressure; ``told``: all notes that the user is given.
    """
    want = volumes / volumes.sum()
    has = np.bincount(number[number >= 0], minlength=len(volumes))
    part = np.array([flow[number == n].sum() for n in range(len(volumes))]) / flow.sum()
    least = LOBE_EXPECTS / len(number) if lobes else 0.0
    empty = np.flatnonzero((has == 0) & (want >= least))
    off = np.flatnonzero((np.abs(part - want) > SHARE_OFF) & (not lobes))
    outside = int((number < 0).sum()) if not lobes else 0
    result = "supplied"
    if len(empty) and "mm³ around" not in told:
        result = "silent"
    elif outside:
        result = "outside"
    elif len(off):
        result = "uneven"
    missed = [round(float(volumes[n]), 3) for n in empty]
    shares = {"share": part.round(4).tolist(), "wanted": want.round(4).tolist()}
    return {"result": result, "empty": missed, "outside": outside} | shares


TIMEOUT_S = 120
_DROP_PA, _VISCOSITY_PA_S = 5332.9, 4e-3
_WRONG = ("silent", "refused", "crashed", "outside", "uneven")


def corners_of(solid: Solid) -> NDArray[np.float64]:
    """Return the corners of a solid's triangles, (f, 3, 3), mm."""
    return solid.points[solid.faces]


def grown(paths: list[Path]) -> Iterator[dict[str, Any]]:
    """What a worker says of each file; one that ends it has crashed, and another goes on."""
    left = list(paths)
    while left:
        begun, done = "", set()
        command = [sys.executable, "-m", "benchmarks.tissue.worker", *map(str, left)]
        limit = TIMEOUT_S * len(left)
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, cwd=ROOT, check=False
        )
        for line in ended.stdout.splitlines():
            said = json.loads(line)
            begun = said.get("begun", begun)
            if "done" in said:
                done.add(said["done"])
                yield said
        left = [path for path in left if path.stem not in done]
        if left:
            last = ended.stderr.strip().splitlines()[-1:] or [""]
            yield {"done": begun, "raised": f"ended with {ended.returncode}: {last[0]}"}
            left = [path for path in left if path.stem != begun]


def judged(case: Case, said: dict[str, Any], path: Path) -> dict[str, Any]:
    """The verdict on one tissue."""
    found: dict[str, Any] = {"tissue": path.stem, "what": case.name, "cpu_s": said.get("cpu_s", 0)}
    if said.get("raised"):
        return found | {"result": "crashed", "message": said["raised"]}
    volumes = np.array([true_volume(part) for part in case.parts])
    if said["refused"]:
        named = "mm³ around" in said["refused"]
        return found | {"result": "named" if named else "refused", "message": said["refused"]}
    net = read_network(path.with_suffix(".csv"))
    ends = _ends(net)
    number = np.full(len(ends), -1)
    for n, part in enumerate(case.parts):
        number[inside(part, ends)] = n
    flow = outlet_flows(net, _DROP_PA, _VISCOSITY_PA_S)
    return found | verdict(volumes, number, flow, case.lobes, said["told"])


def _ends(net: Any) -> Any:
    """Places of the outlets, in the order of their flows."""
    place = np.zeros((net.node_count, 3))
    place[net.node[:, 1]] = net.end
    return place[net.outlets()]


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row of all tissues, with a verdict on each that isn't simply supplied."""
    results: list[Row] = []
    for kind in KINDS:
        with scratch() as folder:
            cases = {f"{kind}-{seed}": make(kind, seed) for seed in range(1 if quick else SEEDS)}
            paths = [folder / f"{name}.stl" for name in cases]
            for path in paths:
                write_stl(path, corners_of(cases[path.stem].mesh))
            for said in grown(paths):
                path = folder / f"{said['done']}.stl"
                results.append(judged(cases[path.stem], said, path))
    count = Counter(one["result"] for one in results)
    wrong = sum(count[name] for name in _WRONG)
    name = f"{len(results)} tissues: silently unsupplied, falsely refused, crashed, uneven"
    odd = [one for one in results if one["result"] != "supplied"]
    yield limited(name, wrong, "tissues", 0) | {"results": dict(count), "not_supplied": odd}
