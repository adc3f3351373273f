"""The paper's cases from shipped recipes, beside its own figures: ``make bench-paper``.

Sexton et al., Science 388 (2025) 1198, doi 10.1126/science.adj6152; its text is read as the
preprint, arXiv 2308.07586. Each recipe is run as a user would, in a process of its own; its files
are judged by the benchmarks' own checkers. ``peer`` holds the other number and where it stands
(docs/paper.md says why the two differ). ``--only panels`` draws the paper's figures as measured
here into ``build/paper_panels.png``. ``--quick`` leaves out what is printed, and 3D. CPU times
count the whole command; growth is a stage's wall clock.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import loop_flows, near_pairs, outlet_flows, read_network, spread
from benchmarks.checkers.poiseuille import graph_flows, resistances
from benchmarks.checkers.read_network import Pieces
from benchmarks.command import Row, run
from benchmarks.machine import ROOT, row
from benchmarks.paper_panels import panels
from benchmarks.paper_places import PAPER
from benchmarks.paper_regions import regions

EXAMPLES = ROOT / "examples"
DROP_PA, BLOOD_PA_S = 40 * 133.322, 4e-3
TOOLKIT = "Synthetic-Vascular-Toolkit a0aec5f, benchmarking"
PRESS = "Stanford's news of 12 June 2025"

TREES = {
    "cube_1000": (1000, TOOLKIT, "cube_cfd.py: 1,000 terminals in 37 mm"),
    "annulus_1000": (1000, TOOLKIT, "anulus_cfd.py: 1,000 terminals"),
    "cortex_8000": (8000, f"{PAPER}, performance of acceleration techniques", "15 min in a gyrus"),
    "heart_8000": (8000, PRESS, "5 h for 1,000,000 vessels in a heart"),
    "four_trees": (800, TOOLKIT, "gif_generator.py: four trees of 200"),
}
PRINTS = {
    "heart_printable": (499, PRESS, "some 500 branches"),
    "ring_closed_loop": (25, PRESS, "25 vessels"),
}


def trees(quick: bool) -> Iterator[Row]:
    """Grown trees: how many, how fast, and whether they perfuse and touch."""
    for name, (count, source, told) in TREES.items():
        with tempfile.TemporaryDirectory() as folder:
            spent = _designed(EXAMPLES / "paper" / f"{name}.yaml", Path(folder), "flow")
            net = read_network(Path(folder) / "network.csv")
            found = len(net.outlets())
            yield row(
                f"{name}: terminals", found, "", str(count), found == count, _peer(source, told)
            )
            yield row(f"{name}: design until flow", round(spent, 1), "CPU s")
            yield row(f"{name}: growth", _stage(folder, "vasculature")["seconds"], "s")
            pairs = len(near_pairs(net, clearance_ratio=0.1).pairs)
            yield row(f"{name}: pairs nearer than a tenth of a radius", pairs, "", "0", pairs == 0)
            off = spread(outlet_flows(net, DROP_PA, BLOOD_PA_S))
            yield row(f"{name}: terminal flows, (max - min) / mean", off, "", "< 1e-9", off < 1e-9)
            flow = _stage(folder, "flow")["summary"]
            yield row(f"{name}: pressure drop", flow["pressure_drop_mmhg"], "mmHg")


def loops(quick: bool) -> Iterator[Row]:
    """Closed loops under the flow of figure 4, by 0D."""
    with tempfile.TemporaryDirectory() as folder:
        _designed(EXAMPLES / "paper" / "cube_closed.yaml", Path(folder), "flow")
        net = read_network(Path(folder) / "network.csv")
        flows = loop_flows(net, DROP_PA, BLOOD_PA_S)
        yield row("cube_closed: loops", len(flows), "", "31", len(flows) == 31)
        yield row("cube_closed: flow of loops, (max - min) / mean", spread(flows), "", "<= 0.01",
                  spread(flows) <= 0.01)  # fmt: skip
        pulse = _stage(folder, "flow")["summary"]["pulsatile"]
        mean, swing = (pulse[f"inlet_flow_{name}_ml_min"] for name in ("mean", "amplitude"))
        yield row("cube_closed: mean flow", mean, "mL/min", "0.25", np.isclose(mean, 0.25).item(),
                  _peer(f"{PAPER}, figure 4G", "0.25 ± 0.1 mL/min"))  # fmt: skip
        yield row("cube_closed: amplitude", swing, "mL/min", "0.1", abs(swing - 0.1) < 1e-3)
        yield from _along_vessels(net, _stage(folder, "flow")["summary"])


def _along_vessels(net: Pieces, said: dict[str, float]) -> Iterator[Row]:
    """Pressure drop and wall shear at 0.25 mL/min by Poiseuille's law, beside the run's own."""
    unit = graph_flows(net, resistances(net, BLOOD_PA_S), 1.0)
    entering = ~np.isin(net.node[:, 0], net.node[:, 1])
    scale = 0.25e3 / 60.0 / float(unit[entering].sum())
    shear = 4.0 * BLOOD_PA_S * scale * np.abs(unit)[:, None] / (np.pi * net.radius**3)
    for name, key, value, measure in (
        ("pressure drop", "pressure_drop_mmhg", scale / 133.322, "mmHg"),
        ("least wall shear", "wall_shear_min_pa", float(shear.min()), "Pa"),
        ("greatest wall shear", "wall_shear_max_pa", float(shear.max()), "Pa"),
    ):
        close = bool(np.isclose(value, said[key], rtol=1e-3))
        yield row(f"cube_closed: {name}", value, measure, f"{said[key]:.4g}", close)


def prints(quick: bool) -> Iterator[Row]:
    """The two networks that were printed: vessels from junction to junction."""
    if quick:
        return
    for name, (count, source, told) in PRINTS.items():
        with tempfile.TemporaryDirectory() as folder:
            _designed(EXAMPLES / f"{name}.yaml", Path(folder), "vasculature")
            net = read_network(Path(folder) / "network.csv")
            found = _between_junctions(net.node)
            yield row(
                f"{name}: vessels", found, "", str(count), found == count, _peer(source, told)
            )
            least = 2.0 * float(net.radius.min())
            yield row(f"{name}: least lumen", least, "mm", ">= 0.4", least >= 0.4 - 1e-9)


def fidelities(quick: bool) -> Iterator[Row]:
    """Figure 4: 3D against the ideal in a cube over a cycle (needs the extra for 3D flow)."""
    if quick:
        return
    with tempfile.TemporaryDirectory() as folder:
        _designed(EXAMPLES / "cube_multifidelity.yaml", Path(folder), "fidelities")
        off = _stage(folder, "fidelities")["summary"]["comparison"]["3D"]
        yield row("cube_multifidelity: 3D against the ideal, flow", off["flow_off_ul_min"],
                  "µL/min", peer=_peer(f"{PAPER}, figure 4G", "0.02 µL/min"))  # fmt: skip
        yield row("cube_multifidelity: the same, pressure", off["pressure_off_mmhg"], "mmHg",
                  peer=_peer(f"{PAPER}, figure 4G", "0.03 mmHg"))  # fmt: skip


def _peer(source: str, told: str) -> dict[str, Any]:
    return {"name": source, "value": told}


def _designed(recipe: Path, folder: Path, until: str) -> float:
    """Run a recipe as far as a stage; CPU seconds of the command."""
    words = ("printctl", "design", str(recipe), "--out", str(folder), "--until", until)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", *words],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        check=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _stage(folder: str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((Path(folder) / "manifest.json").read_text())
    stage: dict[str, Any] = found["stages"][name]
    return stage


def _between_junctions(node: Any) -> int:
    """Pieces less the places where one merely goes on as the next."""
    ends = np.bincount(node.ravel())
    return int(len(node) - (ends == 2).sum())


if __name__ == "__main__":
    run(
        {
            "trees": trees,
            "loops": loops,
            "prints": prints,
            "fidelities": fidelities,
            "regions": regions,
            "panels": panels,
        },
        __doc__,
    )
