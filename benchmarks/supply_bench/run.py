"""Make the tissues, have a tree grown in each, and count what went wrong."""

from __future__ import annotations

import argparse
import json
import resource
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import outlet_flows, read_network
from benchmarks.machine import row
from benchmarks.supply_bench.cases import KINDS, SEEDS, Case, make, true_volume
from benchmarks.supply_bench.judge import inside, verdict
from benchmarks.supply_bench.solids import Solid

TIMEOUT_S = 120
_DROP_PA, _VISCOSITY_PA_S = 5332.9, 4e-3
_WRONG = ("silent", "refused", "crashed", "outside", "uneven")


def write_stl(path: Path, solid: Solid) -> None:
    """A binary STL, as most programs write it: float32, normals zero."""
    corners = solid.points[solid.faces].astype("<f4")
    records = np.zeros(len(corners), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = corners
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(corners)) + records.tobytes())


def grown(paths: list[Path]) -> Iterator[dict[str, Any]]:
    """What a worker says of each file; one that ends it has crashed, and another goes on."""
    left = list(paths)
    while left:
        begun, done = "", set()
        command = [sys.executable, "-m", "benchmarks.supply_bench.worker", *map(str, left)]
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=TIMEOUT_S * len(left)
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


def supply_row(kinds: Sequence[str] = tuple(KINDS), seeds: range = range(SEEDS)) -> dict[str, Any]:
    """The row of the whole battery."""
    results: list[dict[str, Any]] = []
    for kind in kinds:
        with tempfile.TemporaryDirectory() as folder:
            cases = {f"{kind}-{seed}": make(kind, seed) for seed in seeds}
            paths = [Path(folder) / f"{name}.stl" for name in cases]
            for path in paths:
                write_stl(path, cases[path.stem].mesh)
            for said in grown(paths):
                path = Path(folder) / f"{said['done']}.stl"
                results.append(judged(cases[path.stem], said, path))
        counted = Counter(one["result"] for one in results if one["tissue"].startswith(kind + "-"))
        print(kind, dict(counted), file=sys.stderr, flush=True)
    count = Counter(one["result"] for one in results)
    wrong = sum(count[name] for name in _WRONG)
    made = row(
        f"{len(results)} tissues: silently unsupplied, falsely refused, crashed, uneven",
        wrong,
        "of all",
        "0",
        wrong == 0,
    )
    return made | {
        "results": dict(count),
        "cpu_s": round(_children_s(), 1),
        "told": [one for one in results if one["result"] != "supplied"],
    }


def _children_s() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def main() -> None:
    """Run all kinds, or some; print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(KINDS), help="kinds")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed: others make other tissues")
    asked = parser.parse_args()
    print(
        json.dumps(
            supply_row(asked.only, range(asked.first, asked.first + asked.seeds)),
            indent=1,
            ensure_ascii=False,
        )
    )


if __name__ == "__main__":
    main()
