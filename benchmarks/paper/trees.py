"""The paper's trees from shipped recipes, each run as a user would, judged from their files.

Sexton et al., Science 388 (2025) 1198, doi 10.1126/science.adj6152; docs/paper.md holds its figures
beside ours and says why they differ. CPU times count the whole command.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

from benchmarks.checkers import near_pairs, outlet_flows, read_network, spread
from benchmarks.common import ROOT, Row, all_of, limited, printctl, row, scratch, timed

DROP_PA, BLOOD_PA_S = 40 * 133.322, 4e-3
TERMINALS = {"cube_1000": 1000, "annulus_1000": 1000, "cortex_8000": 8000, "heart_8000": 8000}
TERMINALS |= {"four_trees": 800}


def rows(quick: bool) -> Iterator[Row]:
    """Yield how many terminals, how fast, and whether they perfuse and touch."""
    for name, count in list(TERMINALS.items())[: 1 if quick else None]:
        recipe = ROOT / "examples" / "paper" / f"{name}.yaml"
        with scratch() as folder:
            cpu, _, _ = timed(printctl("design", recipe, "--out", folder, "--until", "flow"))
            net = read_network(folder / "network.csv")
            stages = json.loads((folder / "manifest.json").read_text())["stages"]
        found = len(net.outlets())
        yield all_of(f"{name}: terminals", found, count)
        growth = {"growth_s": stages["vasculature"]["seconds"]}
        yield row(f"{name}: design until flow", cpu, "CPU s") | growth
        pairs = len(near_pairs(net, clearance_ratio=0.1).pairs)
        yield limited(f"{name}: pairs nearer than a tenth of a radius", pairs, "", 0)
        off = spread(outlet_flows(net, DROP_PA, BLOOD_PA_S))
        yield limited(f"{name}: terminal flows, (max - min) / mean", off, "", 1e-9)
