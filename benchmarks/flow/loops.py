"""Check flow_3d.csv against plane cuts of flow_3d.vtu.

The cube of `examples/paper/cube_closed.yaml` with 3, 8, 31 and 60 loops. Cuts count whose area is
that of the vessel's own radius; for the parabola, those a diameter and an entrance length away
from both of its ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.checkers.networks import Pieces, read_network
from benchmarks.checkers.vtu_sections import VtuFlow, entrance_length_mm
from benchmarks.common import (
    ROOT,
    Row,
    SkippedError,
    limited,
    printctl,
    read_csv,
    row,
    scratch,
    timed,
)

LOOPS, VISCOSITY_PA_S, DENSITY_G_MM3, UL_S = (3, 8, 31, 60), 4e-3, 1.06e-3, 1000.0 / 60.0
FRACTIONS, AREA_OFF, LIMIT = np.linspace(0.04, 0.96, 24), 0.03, 0.02
MIN_SPAN_RADII = 3.0


def vessel_flow(flow: VtuFlow, net: Pieces, vessel: int) -> tuple[float, float, float]:
    """Return a vessel's flow by its cuts, by their peak speed and by dp/dx, µL/s.

    Medians of ∫v dA and of v_max A / 2 over clean cuts, and π r⁴/8μ dp/dx where it is straight.
    """
    mine = np.flatnonzero(net.vessel == vessel)
    way = np.concatenate([[0.0], np.cumsum(net.length[mine])])
    found = []
    for s in FRACTIONS * way[-1]:
        k = min(int(np.searchsorted(way, s, side="right")) - 1, len(mine) - 1)
        part = (s - way[k]) / net.length[mine[k]]
        along = (net.end[mine[k]] - net.start[mine[k]]) / net.length[mine[k]]
        radius = float(net.radius[mine[k]] @ [1.0 - part, part])
        cut = flow.section(net.start[mine[k]] + (s - way[k]) * along, along, radius)
        if abs(cut.area / (np.pi * radius**2) - 1.0) <= AREA_OFF:
            found.append((s, cut.flow, cut.pressure, cut.parabola_flow))
    if not found:
        return np.nan, np.nan, np.nan
    places, through, pressure, parabola = np.array(found).T
    radius, middle = float(net.radius[mine].mean()), float(np.median(through))
    # 1 Pa s is 1 g/(mm s).
    reynolds = 2.0 * DENSITY_G_MM3 * abs(middle) / (np.pi * radius * VISCOSITY_PA_S)
    clear = 2.0 * radius + entrance_length_mm(radius, reynolds)
    far = parabola[(places > clear) & (places < way[-1] - clear)]
    by_peak = float(np.median(far)) if len(far) else np.nan
    straight = len(mine) == 1 and np.ptp(net.radius[mine]) < 1e-9
    if not straight or np.ptp(places) < MIN_SPAN_RADII * radius:
        return middle, by_peak, np.nan
    slope = float(np.polyfit(places, pressure, 1)[0])
    return middle, by_peak, -slope * np.pi * radius**4 / (8.0 * VISCOSITY_PA_S)


def compare(folder: Path, name: str) -> Iterator[Row]:
    """Yield the rows of one solved network."""
    net, field = read_network(folder / "network.csv"), VtuFlow(next(folder.rglob("flow_3d.vtu")))
    table = read_csv(next(folder.rglob("flow_3d.csv")))
    ours = UL_S * np.array([float(r["flow_ml_min"]) for r in table])
    theirs = np.array([vessel_flow(field, net, vessel) for vessel in range(len(ours))])
    yield row(f"{name}: vessels without a figure", int(np.isnan(ours).sum()), f"of {len(ours)}")
    for what, against in zip(("plane cuts", "parabola", "dp/dx"), theirs.T, strict=True):
        off = np.abs(ours / against - 1.0)
        made = limited(f"{name}: against {what}, worst", float(np.nanmax(off)), "", LIMIT)
        compared, beyond = int(np.isfinite(off).sum()), int((off > LIMIT).sum())
        yield made | {"compared": compared, "off_by_2_percent": beyond}


def rows(quick: bool) -> Iterator[Row]:
    """Grow the cube with several numbers of loops, and solve each in 3D, by the command."""
    if quick:
        raise SkippedError("needs 60 CPU s for its smallest case: not in the quick form")
    text = (ROOT / "examples" / "paper" / "cube_closed.yaml").read_text()
    for loops in LOOPS:
        with scratch() as folder:
            recipe, out = folder / "cube.yaml", folder / "out"
            recipe.write_text(text.replace("terminals: 31", f"terminals: {loops}"))
            timed(printctl("design", recipe, "--until", "vasculature", "--out", out))
            given = ["--inlet-flow-ml-min", "0.25", "--viscosity-mpa-s", 1e3 * VISCOSITY_PA_S]
            given += ["--unit", "mm", "--three-d", "--out", out / "flow"]
            timed(printctl("flow", out / "network.csv", *given))
            yield from compare(out, f"{loops} loops")
