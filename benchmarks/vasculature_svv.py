"""Grow svv's tree in a cube, in svv's own environment.

Prints one JSON line: seconds and peak memory. Writes the tree twice in the columns of
`network.csv`: with the radii that svv gives, and with those that its own ratios give.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from typing import Any

import numpy as np
import pyvista
from svv.domain.domain import Domain
from svv.tree.tree import Tree

DENSITY_G_CM3 = 1.06
COLUMNS = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"


def grow(domain: Any, side_cm: float, terminals: int, flow_ul_s: float, poise: float) -> Any:
    """The tree, rooted in the middle of the top face; 40 mmHg is svv's own default."""
    tree = Tree()
    tree.parameters.set("kinematic_viscosity", poise / DENSITY_G_CM3)
    tree.parameters.set("terminal_flow", flow_ul_s * 1e-3 / terminals)
    tree.set_domain(domain)
    tree.set_root(np.array([side_cm / 2, side_cm / 2, side_cm]), np.array([0.0, 0.0, -1.0]))
    tree.n_add(terminals - 1)
    return tree


def cube(side_cm: float, seed: int) -> Any:
    """The cube as a domain."""
    middle = (side_cm / 2,) * 3
    surface = pyvista.Cube(center=middle, x_length=side_cm, y_length=side_cm, z_length=side_cm)
    domain = Domain(surface.triangulate())
    domain.set_random_seed(seed)
    domain.create()
    domain.solve()
    domain.build()
    return domain


def ratio_radii(data: Any) -> Any:
    """Root radius times the ratios on the way down, cm."""
    radius = np.empty(len(data))
    radius[0] = data[0, 21]
    waiting = [0]
    while waiting:
        i = waiting.pop()
        if not np.isnan(data[i, 15]):
            for child, ratio in ((int(data[i, 15]), 23), (int(data[i, 16]), 24)):
                radius[child] = radius[i] * data[i, ratio]
                waiting.append(child)
    return radius


def write(path: str, data: Any, radius: Any) -> None:
    """The tree in mm."""
    columns = [np.arange(len(data)), data[:, 18], data[:, 19], *(10 * data[:, :6].T)]
    columns += [10 * radius, 10 * radius]
    rows = np.column_stack(columns)
    with open(path, "w", encoding="utf-8") as out:
        out.write(COLUMNS + "\n")
        for row in rows.tolist():
            whole = ",".join(str(int(value)) for value in row[:3])
            out.write(whole + "," + ",".join(map(repr, row[3:])) + ",artery,0\n")


def main() -> None:
    """Grow, write, print."""
    parser = argparse.ArgumentParser()
    for name in ("--side-mm", "--flow-ul-s", "--viscosity-pa-s"):
        parser.add_argument(name, type=float, required=True)
    parser.add_argument("--terminals", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--out-ratios", required=True)
    asked = parser.parse_args()
    np.random.seed(asked.seed)  # noqa: NPY002 (svv draws from it)
    poise, side_cm = 10.0 * asked.viscosity_pa_s, asked.side_mm / 10.0
    begin = time.perf_counter()
    domain = cube(side_cm, asked.seed)
    built = time.perf_counter()
    grow(domain, side_cm, 20, asked.flow_ul_s, poise)
    warm, cpu = time.perf_counter(), time.process_time()
    tree = grow(domain, side_cm, asked.terminals, asked.flow_ul_s, poise)
    seconds, cpu = time.perf_counter() - warm, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    data = np.asarray(tree.data)
    write(asked.out, data, data[:, 21])
    write(asked.out_ratios, data, ratio_radii(data))
    print(
        json.dumps(
            {"tissue_s": built - begin, "growth_s": seconds, "growth_cpu_s": cpu, "peak_mb": peak}
        )
    )


if __name__ == "__main__":
    main()
