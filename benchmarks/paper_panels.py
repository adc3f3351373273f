"""The paper's figures 2B, C, F, H, I, S1 and S3 measured for printctl, drawn in one picture.

``make bench-paper BENCH="--only panels"``. What the paper's text states is drawn as marks; none of
its figures is copied. Times are CPU times of one thread, once all is compiled.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from timeit import repeat
from typing import Any

import numba
import numpy as np
import trimesh

from benchmarks import paper_plain as plain
from benchmarks.checkers import winding_numbers
from benchmarks.checkers.containment import surface_tree
from benchmarks.command import Row
from benchmarks.machine import ROOT, machine, row
from benchmarks.paper_places import PAPER, accuracy_panels, law_of, segments_of
from benchmarks.vasculature_grow import warm_up
from design.tissue import Tissue, block, folded_cortex, tissue_from_surface
from design.vasculature import GrowthOptions, grow_tree
from design.vasculature.growth.fit import growth_factor
from design.vasculature.growth.growth_state import CELL, clearances_of, index_segments
from design.vasculature.growth.index import nearest_segments
from design.vasculature.treemath import tree_radii

PICTURE = ROOT / "build" / "paper_panels.png"
SIDE_MM = 10.0
NOTE = """Black and grey marks: stated in the paper's text (arXiv
2308.07586). Its own 2B is drawn over tree depth.
Times: CPU, one thread; dotted: extrapolated.
Shaded: 2 standard deviations; 2C: worst to best.
Accuracy: the part achieved of what can be saved over
a branch at the vessel's middle. S1: NumPy rescales
by one factor, the others by each vessel's ratio."""
SPEED = {"name": f"{PAPER}, performance of acceleration techniques"}
GOALS = {"search": 6, "rescaling": 28, "collision": 5}
"""Of the paper's arrays over a linked list; rescaling's is of 500 terminals and more."""


def cpu_s(task: Callable[[], Any], lots: int = 1, calls: int = 1) -> float:
    """Return the CPU time of a call, s: the least of the means of some lots."""
    return min(repeat(task, timer=time.process_time, repeat=lots, number=calls)) / calls


def shaded(axes: Any, x: Any, samples: Any, colour: str, name: str) -> None:
    """Draw means, and two standard deviations about them down to a tenth of the mean."""
    mean, spread = np.mean(samples, axis=1), 2 * np.std(samples, axis=1)
    axes.plot(x, mean, "o-", ms=3, color=colour, label=name)
    low = np.maximum(mean - spread, 0.1 * mean)
    axes.fill_between(x, low, mean + spread, color=colour, alpha=0.15, lw=0)


def growth_panel(axes: Any, cube: Tissue, quick: bool) -> Iterator[Row]:
    """2B: time of growth against the number of vessels."""
    points = np.random.default_rng(1).uniform(0, SIDE_MM, (2001, 3))
    points[0] = SIDE_MM / 2, SIDE_MM / 2, SIDE_MM
    plain.grow_by_traversals(points[:5], 3.0)
    for name, task, colour, sizes in (
        ("printctl", lambda n: grow_tree(cube, GrowthOptions(terminals=n)), "C0",
         250 * 2 ** np.arange(4 if quick else 7)),
        ("whole-tree traversals", lambda n: plain.grow_by_traversals(points[: n + 1], 3.0), "C3",
         125 * 2 ** np.arange(3 if quick else 5)),
    ):  # fmt: skip
        took = np.array([cpu_s(partial(task, n)) for n in sizes.tolist()])
        power = float(np.polyfit(np.log(sizes[-3:]), np.log(took[-3:]), 1)[0])
        axes.plot(2 * sizes - 1, took, "o-", ms=3, color=colour, label=f"{name}: N^{power:.2f}")
        found = row(f"panel 2B: {name}, exponent of growth's time", round(power, 2), "")
        yield found | {"terminals": sizes.tolist(), "cpu_s": took.round(3).tolist()}
    ahead = np.array([2 * sizes[-1] - 1, 15_999])
    axes.plot(ahead, took[-1] * (ahead / ahead[0]) ** power, ":", color=colour)
    shape = folded_cortex()
    gyrus_tissue = tissue_from_surface(shape.vertices, shape.faces)
    gyrus = cpu_s(lambda: grow_tree(gyrus_tissue, GrowthOptions(terminals=8000)))
    axes.plot(15_999, gyrus, "*", ms=9, color="C0", label="printctl, gyrus phantom")
    for said, seconds in (("paper, gyrus: 15 min", 900), ("others, gyrus: 59.96 h", 215_856)):
        axes.plot(15_999, seconds, "D", color="0.3")
        axes.text(11_000, seconds, said, ha="right", va="center")
    axes.set(title="2B: time of growth", xscale="log", yscale="log", ylim=(3e-3, 1e8))
    axes.set(xlabel="vessels", ylabel="growth (CPU s)")
    told, name = SPEED | {"value": "15 min; others 59.96 h"}, "panel 2B: 8,000 terminals in a gyrus"
    yield row(name, round(gyrus, 2), "CPU s", "<= 900", gyrus <= 900, told)


def enclosure_panel(axes: Any, quick: bool) -> Iterator[Row]:
    """2F: time of a point-enclosure query against the mesh's size."""
    rng = np.random.default_rng(1)
    faces, alike = np.empty(4 if quick else 6, int), []
    times = np.empty((2, len(faces), 25))
    for at, lot in np.ndindex(times.shape[1:]):
        if lot == 0:
            ball = trimesh.creation.icosphere(at + 2, radius=5.0)
            bumps = 1 + 0.1 * np.sin(1.5 * ball.vertices).sum(axis=1)
            tissue = tissue_from_surface(ball.vertices * bumps[:, None], ball.faces)
            corners = tissue.surface.vertices[tissue.surface.faces]
            tree, faces[at] = surface_tree(corners), len(corners)
            tissue.contains(corners[:, 0])
        points = rng.uniform(*tissue.bounds, (20_000, 3))  # new ones, that no cache knows
        inside = []
        for task in (tissue.contains, partial(winding_numbers, triangles=corners, tree=tree)):
            begin = time.process_time()
            inside.append(task(points) > 0)
            times[len(inside) - 1, at, lot] = (time.process_time() - begin) / len(points) * 1e9
        alike.append(float(np.mean(inside[0] == inside[1])))
    names = ("printctl", "mesh in a tree of boxes")
    for name, lots, colour in zip(names, times, ("C0", "C3"), strict=True):
        shaded(axes, faces, lots, colour, name)
        found = row(f"panel 2F: {name}, a point, {faces[-1]:,} faces", lots[-1].mean(), "CPU ns")
        yield found | {"faces": faces.tolist(), "cpu_ns": lots.mean(axis=1).round().tolist()}
    axes.set(title="2F: point enclosure", xscale="log", yscale="log", ylim=(10, 1e5))
    axes.set(xlabel="faces of the mesh", ylabel="one point (CPU ns)")
    yield row("panel 2F: points judged alike, least", min(alike), "", ">= 0.99", min(alike) >= 0.99)


class Grown:
    """A grown tree with what growth keeps of it, and new vessels to random points.

    Each begins in the middle of the nearest vessel, and is as thin as the tree's thinnest.
    """

    def __init__(self, tissue: Tissue, terminals: int, seed: int, count: int) -> None:
        options = GrowthOptions(terminals=terminals, seed=seed)
        self.tree = tree = grow_tree(tissue, options)
        self.radius, self.segments = tree_radii(tree), segments_of(tree, law_of(tree))
        self.room = clearances_of(tissue, options)._replace(clearance=0.0, ratio=0.0, reserve=1.0)
        cell, own = CELL * float(np.cbrt(tissue.volume_mm3 / terminals)), len(tree.parent)
        self.index = index_segments(tissue.bounds, cell, self.segments, own, 0, self.room)
        self.ends = np.random.default_rng(seed).uniform(0, SIDE_MM, (count, 3))
        self.left = [int(plain.array_nearest(tree, t)[0]) for t in self.ends]
        begins = (tree.proximal + tree.distal)[self.left] / 2
        pairs = zip(begins.tolist(), self.ends.tolist(), strict=True)
        self.new = [plain.Vessel(*pair, float(self.radius.min())) for pair in pairs]

    def nearest(self, point: Any) -> Any:
        """Return the ten vessels nearest to a point, as growth finds them."""
        found, away = np.empty(plain.CANDIDATES, np.int32), np.empty(plain.CANDIDATES)
        nearest_segments(self.index, self.segments, *point, 0.0, found, away)
        return found

    def meets(self, new: plain.Vessel, leaves: int) -> bool:
        """Whether a new vessel meets any but the one it leaves, as growth finds it."""
        skip, ends = (leaves, -1, -1, -1, -1, -1, -1), (*new.proximal, *new.distal)
        given = (self.index, self.segments, self.room, *ends, new.radius, skip, False)
        return bool(growth_factor(*given) < self.room.reserve)


def collision_panels(left: Any, right: Any, cube: Tissue, quick: bool) -> Iterator[Row]:
    """2H and 2I: exact tests of a new vessel, and the pairs that are settled without."""
    sizes = 125 * 2 ** np.arange(-2.0, 4 if quick else 7)
    found = np.empty((3, len(sizes), 4, 5 if quick else 25))
    for at, seed in np.ndindex(found.shape[1:3]):
        grown = Grown(cube, int(sizes[at]), seed, found.shape[-1])
        for n, new in enumerate(grown.new):
            grown.meets(new, grown.left[n])
            tests = np.count_nonzero(grown.index.stamp == grown.index.query[0]) - 1
            balls = len(plain.balls_meet(grown.tree, grown.radius, new)) - 1
            found[:, at, seed, n] = tests, balls, 100 * (1 - tests / (len(grown.radius) - 1))
    exact, balls, settled = found.reshape(3, len(sizes), -1)
    shaded(left, 2 * sizes - 1, exact, "C0", "left by printctl's grid of cells")
    shaded(left, 2 * sizes - 1, balls, "C1", "left by bounding balls, the paper's test")
    left.axhspan(1, 2, color="0.85", label="paper: 1 or 2 for the majority")
    left.set(title="2H: collision tests", xscale="log", xlabel="vessels", ylim=(0, 45))
    left.set(ylabel="exact tests of a new vessel")
    shaded(right, 2 * sizes - 1, settled, "C0", "printctl")
    right.set(title="2I: pairs settled without exact test", xscale="log", xlabel="vessels")
    right.set(ylabel="pairs settled (%)", ylim=(0, 103))
    for at in (4, -1):
        tree, told = f"{sizes[at]:,.0f} terminals", SPEED | {"value": "1 or 2 for the majority"}
        yield row(f"panel 2H: exact tests of a new vessel, {tree}", exact[at].mean(), "", peer=told)
        yield row(f"panel 2H: left by bounding balls, {tree}", balls[at].mean(), "", peer=told)
        yield row(f"panel 2I: pairs settled without, {tree}", settled[at].mean(), "%")


def routines(g: Grown) -> Iterator[tuple[str, list[Callable[[], Any]]]]:
    """Yield each routine by linked objects, by NumPy and by printctl, called from Python."""
    vessels = plain.linked(g.tree)
    root, pairs = vessels[0], list(zip(g.new, g.left, strict=True))

    def near(new: plain.Vessel) -> Iterator[plain.Vessel]:
        return (vessels[i] for i in plain.balls_meet(g.tree, g.radius, new))

    yield (
        "search",
        [
            lambda: [plain.linked_nearest(root, one.distal) for one in g.new],
            lambda: [plain.array_nearest(g.tree, end) for end in g.ends],
            lambda: [g.nearest(end) for end in g.ends],
        ],
    )
    # NumPy multiplies by one factor, as the paper; the others by ratios, which do more.
    radius, slow = g.radius, partial(plain.linked_rescale, root, g.radius[0])
    yield "rescaling", [slow, lambda: radius * 1.1, partial(tree_radii, g.tree)]
    yield (
        "collision",
        [
            lambda: [plain.meets(plain.walk(root), new, vessels[i]) for new, i in pairs],
            lambda: [plain.meets(near(new), new, vessels[i]) for new, i in pairs],
            lambda: [g.meets(new, i) for new, i in pairs],
        ],
    )


def routine_panel(axes: Any, cube: Tissue) -> Iterator[Row]:
    """S1: three routines of growth against a linked list."""
    bars = {}
    for terminals in (250, 2000):
        for name, tasks in routines(Grown(cube, terminals, 1, 10)):
            if name == "collision" and not tasks[0]() == tasks[1]() == tasks[2]():
                raise RuntimeError("the three collision tests disagree")
            linked, arrays, ours = (cpu_s(task, 3, 10) for task in tasks)
            bars[f"{name}\n{2 * terminals - 1:,}"] = linked / ours, linked / arrays, GOALS[name]
            told = {"name": f"{PAPER}, figure S1", "value": f"{GOALS[name]}-fold, arrays"}
            bar = "" if name == "rescaling" and terminals < 500 else f">= {GOALS[name]}"
            measure = (
                f"panel S1: {name}, {2 * terminals - 1:,} vessels, linked list's time over ours"
            )
            found = row(measure, linked / ours, "", bar, linked / ours >= GOALS[name], told)
            yield found | {"linked_over_numpy": linked / arrays}
    at, (ours, arrays, goals) = np.arange(len(bars)), np.transpose(list(bars.values()))
    axes.bar(at - 0.2, ours, 0.4, color="C0", label="printctl")
    axes.bar(at + 0.2, arrays, 0.4, color="C2", label="NumPy arrays")
    axes.hlines(goals, at - 0.45, at + 0.45, color="k", label="paper's arrays: 6, 28, 5")
    axes.set_xticks(at, list(bars), fontsize=7)
    axes.set(title="S1: three routines", yscale="log", ylim=(1, 2e4), xlabel="routine, vessels")
    axes.set(ylabel="times faster than a linked list")


def panels(quick: bool) -> Iterator[Row]:
    """Measure all panels and draw them into `PICTURE`; quick: smaller trees and meshes."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    numba.set_num_threads(1)
    warm_up()
    shape = block((SIDE_MM,) * 3)
    cube = tissue_from_surface(shape.vertices, shape.faces)
    tree = grow_tree(cube, GrowthOptions(terminals=1500 if quick else 8000))
    with plt.rc_context({"font.size": 8, "legend.fontsize": 7, "legend.title_fontsize": 7}):
        figure, axes = plt.subplots(2, 4, figsize=(15, 7), layout="constrained")
        b, c, f, h, i, s1, s3, note = axes.flat
        yield from growth_panel(b, cube, quick)
        yield from accuracy_panels(c, s3, tree, quick)
        yield from routine_panel(s1, cube)
        yield from enclosure_panel(f, quick)
        yield from collision_panels(h, i, cube, quick)
        for one in (b, c, s3, s1, f, h, i):
            one.grid(alpha=0.25)
            one.legend(loc="lower right" if one in (c, s3, i) else "upper left")
        note.axis("off")
        note.text(0, 0.95, NOTE, va="top")
        figure.suptitle(f"Sexton et al. 2025 by printctl; {machine()['processor']}")
        PICTURE.parent.mkdir(exist_ok=True)
        figure.savefig(PICTURE, dpi=110)
        plt.close(figure)
    print(f"panels drawn in {PICTURE}", file=sys.stderr, flush=True)
