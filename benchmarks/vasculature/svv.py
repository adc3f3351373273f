"""Grow svv's tree in a cube, in svv's own environment; prints seconds as one JSON line.

``python svv.py TERMINALS SIDE_MM FLOW_UL_S OUT``: writes the tree in the columns of `network.csv`.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import pyvista
from svv.domain.domain import Domain
from svv.tree.tree import Tree

DENSITY_G_CM3, POISE, SEED = 1.06, 0.04, 1
COLUMNS = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"


def grow(domain: Any, side_cm: float, terminals: int, flow_ul_s: float) -> Any:
    """Return the tree, rooted in the middle of the top face; 40 mmHg is svv's own default."""
    tree = Tree()
    tree.parameters.set("kinematic_viscosity", POISE / DENSITY_G_CM3)
    tree.parameters.set("terminal_flow", flow_ul_s * 1e-3 / terminals)
    tree.set_domain(domain)
    tree.set_root(np.array([side_cm / 2, side_cm / 2, side_cm]), np.array([0.0, 0.0, -1.0]))
    tree.n_add(terminals - 1)
    return tree


def cube(side_cm: float) -> Any:
    """Return the cube as a domain."""
    middle = (side_cm / 2,) * 3
    surface = pyvista.Cube(center=middle, x_length=side_cm, y_length=side_cm, z_length=side_cm)
    domain = Domain(surface.triangulate())
    domain.set_random_seed(SEED)
    domain.create()
    domain.solve()
    domain.build()
    return domain


def write(path: str, data: Any) -> None:
    """Write the tree, in mm."""
    radius = 10 * data[:, 21]
    columns = [np.arange(len(data)), data[:, 18], data[:, 19], *(10 * data[:, :6].T)]
    rows = np.column_stack([*columns, radius, radius])
    with open(path, "w", encoding="utf-8") as out:
        out.write(COLUMNS + "\n")
        for row in rows.tolist():
            whole = ",".join(str(int(value)) for value in row[:3])
            out.write(whole + "," + ",".join(map(repr, row[3:])) + ",artery,0\n")


def main() -> None:
    """Grow, write, print."""
    terminals, side_cm, flow_ul_s = int(sys.argv[1]), float(sys.argv[2]) / 10, float(sys.argv[3])
    np.random.seed(SEED)  # noqa: NPY002 (svv draws from it)
    domain = cube(side_cm)
    grow(domain, side_cm, 20, flow_ul_s)
    wall, cpu = time.perf_counter(), time.process_time()
    tree = grow(domain, side_cm, terminals, flow_ul_s)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    write(sys.argv[4], np.asarray(tree.data))
    print(json.dumps({"growth_s": wall, "growth_cpu_s": cpu}))


if __name__ == "__main__":
    main()
