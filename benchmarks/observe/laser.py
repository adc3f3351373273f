"""Benchmark of a laser line profiler's looks: false gaps, detection, length, widths, time.

Height maps by `checkers.profiler_painter`: lines of 0.2 to 0.45 mm on a plate, in lattices and in
solid layers; shadows, lost points, spikes. Wall clock of a file's reading and judgement on a quiet
machine.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from benchmarks.checkers.profiler_painter import Bare, Kind, Profiled, profiled
from benchmarks.common import Row, limited, row, scratch
from printctl.inspection import ExpectedLines, Gap, LayerFindings, see_layer, surface_of
from registration.files.readers.heights import HeightMap, read_heights

KINDS: tuple[Kind, ...] = ("plate", "lattice", "solid")
LENGTHS_MM = (0.2, 0.3, 0.5, 1.0)
PLANTED = 20
"""Gaps of each length in each kind of layer."""
_BIG_MM, _BIG_PX_MM = 20.0, 0.02


def expected(map_: Profiled) -> ExpectedLines:
    """The lines of a painted map; each is a stroke of its own."""
    number = np.arange(len(map_.start))
    width, fresh = np.full(len(number), map_.width), map_.layer == map_.layer.max()
    return ExpectedLines(map_.start, map_.end, width, number, number, fresh)


def look(map_: Profiled) -> LayerFindings:
    """Judge a painted map as an observer does."""
    lines = expected(map_)
    heights = HeightMap(map_.heights, (map_.px, map_.px))
    surface = surface_of(heights, map_.to_map, map_.middle_z, map_.thickness, lines)
    return see_layer(
        surface.picture, surface.frame, lines, hidden=surface.hidden, thickness_mm=map_.thickness
    )


def planted(seed: int, kind: Kind, length: float) -> tuple[LayerFindings, int, Bare]:
    """Look at a layer with a gap in its middle; findings, the gap's stroke, and the gap."""
    plain = profiled(seed, kind)
    top = np.flatnonzero(plain.layer == plain.layer.max())
    rng = np.random.default_rng((seed, 6))
    line = int(rng.integers(1, len(top) - 1))
    long = float(np.linalg.norm(plain.end[top[line]] - plain.start[top[line]]))
    begin = float(rng.uniform(0.2 * long, 0.8 * long - length))
    bare = (line, begin, begin + length)
    found = look(profiled(seed, kind, (bare,)))
    if line % 2:  # it is written back
        begin = long - begin - length
    return found, int(top[line]), (line, begin, begin + length)


def _is_seen(found: LayerFindings, stroke: int, bare: Bare) -> bool:
    """Whether the look saw the station in the middle of a gap."""
    s = found.stations
    own = np.flatnonzero(s.stroke == stroke)
    middle = own[np.abs(s.along_mm[own] - (bare[1] + bare[2]) / 2).argmin()]
    return bool(s.seen[middle])


def sound_rows(kind: Kind, layers: int) -> Iterator[Row]:
    """Yield gaps found in layers without any."""
    found = [look(profiled(seed, kind)) for seed in range(layers)]
    false = sum(bool(one.gaps) for one in found)
    share = float(np.mean([one.seen_share for one in found]))
    made = limited(f"{kind}: sound layers with a gap found", false, f"of {layers}", 0)
    yield made | {"blobs": sum(len(one.blobs) for one in found), "seen_share": round(share, 3)}


def gap_rows(kind: Kind, length: float, count: int) -> Iterator[Row]:
    """Yield gaps found in layers with one each."""
    seen, hit, other = 0, 0, 0
    for seed in range(100_000, 100_000 + count):
        found, stroke, bare = planted(seed, kind, length)
        own = [one for one in found.gaps if one.stroke == stroke and _overlap(one, bare)]
        seen += bool(own) or _is_seen(found, stroke, bare)
        hit += bool(own)
        other += len(found.gaps) - len(own)
    of = f"of {seen} seen, {count} planted"
    made = row(f"{kind}: gaps of {length:g} mm found", hit, of, "all seen", hit == seen)
    yield made | {"false_ones_beside": other}


def _overlap(gap: Gap, bare: Bare) -> bool:
    return gap.from_mm < bare[2] and gap.to_mm > bare[1]


def seconds_of_a_look() -> float:
    """Wall time from a profiler's file of 20 x 20 mm at 20 µm to what is found in it."""
    map_ = profiled(1, "solid", size=_BIG_MM, px=_BIG_PX_MM)
    with scratch() as folder:
        path = folder / "map.tif"
        cv2.imwrite(str(path), map_.heights)
        begun = time.perf_counter()
        look(replace(map_, heights=read_heights(path, (map_.px, map_.px)).height_mm))
        return time.perf_counter() - begun


def rows(quick: bool) -> Iterator[Row]:
    """Yield the time of a look, then sound layers and gaps of each kind of layer."""
    yield limited("20 x 20 mm at 20 µm judged", seconds_of_a_look(), "s", 2.0)
    layers, planted_each = (2, 1) if quick else (60, PLANTED)
    for kind in KINDS:
        yield from sound_rows(kind, layers)
        for length in LENGTHS_MM[-1:] if quick else LENGTHS_MM:
            yield from gap_rows(kind, length, planted_each)
