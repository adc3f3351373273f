"""A laser profiler's frame and files, as an observer opens them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import yaml

from benchmarks.checkers.profiler_painter import profiled
from benchmarks.observe.laser import expected
from printctl.errors import UsageError
from printctl.inspection import ExpectedLines, HeightFrame
from printctl.observe.deciding.evidence import MapCheck
from printctl.observe.devices import DeviceError
from printctl.observe.inspection_state import InspectionState
from printctl.observe.looks.height_maps import (
    ScanSize,
    read_profiler_frame,
    refuse_elsewhere,
    refuse_other_height,
    try_laser_frame,
)
from printctl.observe.looks.map_history import MapHistory
from printctl.observe.looks.views import View, open_view
from registration.devices.lens.lens import write_model as write_frame_laser_sweep
from registration.devices.lens.lens import write_model as write_laser
from registration.errors import PictureError
from registration.files.readers.heights import HeightMap
from registration.scan import Scan
from tests.printctl.cli.test_pause_commands import observe
from tests.registration.devices.camera_frame import scene
from tests.registration.devices.laser_sweep import sweeps


def write_frame(path: Path, **changes: object) -> Path:
    path.write_text(yaml.safe_dump({"printer_to_scan": np.eye(4).tolist(), **changes}))
    return path


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"printer_to_scan": [[1, 0], [0, 1]]}, "four rows of four numbers"),
        ({"printer_to_scan": np.diag([1.0, 1.0, 0.0, 1.0]).tolist()}, "to the same one"),
        ({"printer_to_scan": (2 * np.eye(4)).tolist()}, "0, 0, 0, 1 as its last row"),
        ({"count_mm": float("inf")}, "above 0 mm"),
        ({"pixel_mm": 0.02}, "two numbers"),
        ({"pixel_mm": [0.02, 0]}, "above 0 mm"),
        ({"count_mm": -1}, "above 0 mm"),
        ({"lost": "none"}, "one each"),
        ({"size": [400.0, 300]}, r"size is \[400.0, 300\]; it is \[columns, rows\]"),
        ({"pixel_um": [20, 20]}, "pixel_um means nothing; known are count_mm"),
    ],
)
def test_a_wrong_frame_is_refused(tmp_path: Path, changes: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_profiler_frame(write_frame(tmp_path / "frame.yaml", **changes))


def opened(folder: Path, heights: np.ndarray, frame: Path | None) -> View:
    map_ = profiled(1, "plate")
    path = folder / "picture.npy"
    np.save(path, heights)
    if frame is None:
        path = folder / "picture.npz"
        np.savez(path, height_mm=heights, pixel_mm=np.full(2, map_.px), printer_to_scan=map_.to_map)
    order = SimpleNamespace(oct=False, laser=True, frame=str(frame or ""))
    return open_view(path, cast(Any, order), map_.middle_z, map_.thickness, expected(map_))


@pytest.mark.parametrize("seed", range(6))
def test_heights_in_another_unit_are_told_by_what_stands_on_the_plate(
    tmp_path: Path, seed: int
) -> None:
    map_ = profiled(seed, "plate")

    def looked_at(times: float) -> None:
        heights = 3.0 + times * (map_.heights - 3.0)
        np.savez(
            tmp_path / "a.npz",
            height_mm=heights, pixel_mm=np.full(2, map_.px), printer_to_scan=map_.to_map,
        )  # fmt: skip
        order = cast(Any, SimpleNamespace(oct=False, laser=True, frame=""))
        lines = expected(map_)
        view = open_view(tmp_path / "a.npz", order, map_.middle_z, map_.thickness, lines)
        refuse_other_height(view.size, 1.0, 0.9)
        refuse_other_height(None, 1.0, 0.9)

    looked_at(1.0)
    with pytest.raises(DeviceError, match=r"stand 0\.00[01][0-9]* times .*count_mm"):
        looked_at(0.001)
    with pytest.raises(DeviceError, match=r"stand 2\.[0-9] times|over the layer's top.*count_mm"):
        looked_at(2.4)
    with pytest.raises(DeviceError, match=r"µm over the layer's top along the lines.*count_mm"):
        looked_at(1000.0)


def test_a_map_in_which_nothing_was_measured_holds_the_print(tmp_path: Path) -> None:
    nothing = np.full_like(profiled(1, "plate").heights, np.nan)
    with pytest.raises(DeviceError, match=r"picture\.npz: the profiler measured no height at all"):
        opened(tmp_path, nothing, None)


# --- a laser line with a camera, as an observer sees it: a folder of pictures becomes a layer
def lines_on_blocks() -> ExpectedLines:
    """A line along each block's top, written as 0.9 mm high ones."""
    at = [(sweeps.LOW[0] + (left + right) / 2, high) for left, right, high in sweeps.BLOCKS]
    start, end = (
        np.array([(x, sweeps.LOW[1] + y, sweeps.FLOOR_Z + high) for x, high in at])
        for y in (1.5, 5.5)
    )
    number = np.arange(2)
    return ExpectedLines(start, end, np.full(2, 1.2), number, number, np.array([False, True]))


def test_pictures_of_a_look_become_heights_of_its_layer(tmp_path: Path) -> None:
    file = tmp_path / "laser.yaml"
    write_laser(file, sweeps.fitted(tmp_path / "flat").laser)
    try_laser_frame(file)
    order = cast(Any, SimpleNamespace(oct=False, laser=True, frame=str(file)))
    look = sweeps.written(sweeps.over_blocks(), tmp_path / "picture")
    view = open_view(look, order, sweeps.FLOOR_Z + 0.45, 0.9, lines_on_blocks())
    assert view.size is not None
    assert "-" in view.size.words or "+" in view.size.words  # µm over the layer's top
    assert view.hidden is not None
    assert view.hidden.mean() < 0.5
    bumped = [np.roll(one, 4, axis=1) for one in sweeps.over_blocks()]
    moved = sweeps.written(bumped, tmp_path / "moved")
    with pytest.raises(DeviceError, match="frame doesn't hold any more"):
        open_view(moved, order, sweeps.FLOOR_Z + 0.45, 0.9, lines_on_blocks())
    dark = sweeps.written([scene.picture()] * 3, tmp_path / "dark")
    with pytest.raises(DeviceError, match="in 0 of 3 pictures"):
        open_view(dark, order, sweeps.FLOOR_Z + 0.45, 0.9, lines_on_blocks())
    file.write_text("printctl_laser: 1\n")
    with pytest.raises(PictureError, match="observe sweep"):
        try_laser_frame(file)


def test_the_command_fits_a_laser(tmp_path: Path) -> None:
    write_frame_laser_sweep(tmp_path / "frame.yaml", scene.frame())
    flat = sweeps.written(sweeps.flat(), tmp_path / "flat")
    out = tmp_path / "laser.yaml"
    done = observe("sweep", flat, "--frame", tmp_path / "frame.yaml", "--floor-z", "1", "-o", out)
    assert "of 24 used" in done.stdout
    assert "heights             ±" in done.stdout
    try_laser_frame(out)


# --- a look's map beside the last look's
_TO_MAP = np.eye(4)


def _look(
    number: int,
    rows: int,
    cell_mm: float = 0.02,
    to_map: np.ndarray = _TO_MAP,
    top: float = 0.2,
    block: slice | None = None,
    **changes: object,
) -> tuple[Any, Any]:
    """A look with a line in the map's middle, and its map of bare ground, with a block on it."""
    start, end = np.array([[1.0, 3.0, top]]), np.array([[5.0, 3.0, top]])
    number_of = np.zeros(1, np.int64)
    lines = ExpectedLines(start, end, np.full(1, 0.3), number_of, number_of, np.ones(1, bool))
    heights = np.random.default_rng(number).normal(0.0, 0.005, (rows, 300)).astype(np.float32)
    if block is not None:
        heights[block, 100:200] += top
    given = HeightMap(heights, (cell_mm, cell_mm))
    size = replace(ScanSize.from_heights(given, to_map), **cast(Any, changes))
    at = SimpleNamespace(
        look=SimpleNamespace(number=number),
        layer=SimpleNamespace(lines=lines, row=np.zeros(1, np.int64)),
        slab_mm=(top - 0.05, 0.1),
        since=np.ones(1, bool),
    )
    picture = np.stack([np.clip((heights - top + 0.05) / 0.1, -0.5, 1.5), heights - top + 0.05], 2)
    view = SimpleNamespace(
        taken=heights, size=size, hidden=np.zeros(heights.shape, bool), image=picture,
        frame=HeightFrame(np.diag([1 / cell_mm, 1 / cell_mm, 1.0, 1.0])), thickness_mm=0.1,
    )  # fmt: skip
    return cast(Any, at), cast(Any, view)


def test_a_map_with_fewer_rows_than_the_last_looks_lacks_them() -> None:
    maps = MapHistory()
    assert not maps.check(*_look(1, 300)).lacks
    assert (
        maps.check(*_look(2, 280)).lacks == "lacks 20 of 300 rows (400 µm) against the last look's"
    )
    assert "10 of 300 rows (200 µm)" in maps.check(*_look(2, 290)).lacks  # the second picture
    assert not maps.check(*_look(3, 300)).lacks  # compared with the last whole one
    assert not maps.check(*_look(4, 310)).lacks
    assert maps.check(*_look(5, 300)).lacks


def test_a_first_map_is_compared_with_the_size_that_its_frame_names() -> None:
    assert MapHistory().check(*_look(1, 300)) == MapCheck(unsized=True)
    assert MapHistory().check(*_look(1, 300, placed=True)) == MapCheck()
    assert MapHistory().check(*_look(1, 300, whole=(300, 300))) == MapCheck()
    lacks = MapHistory().check(*_look(1, 280, whole=(300, 300))).lacks
    assert lacks == "lacks 20 of 300 rows (400 µm) that observe.frame names"
    assert not MapHistory().check(*_look(1, 298, whole=(300, 300))).lacks


def test_what_stood_there_and_is_gone_tells_of_rows_that_were_filled_up() -> None:
    maps = MapHistory()
    maps.check(*_look(1, 300, block=slice(50, 100)))
    assert not maps.check(*_look(2, 300, block=slice(50, 100))).lacks
    moved = maps.check(*_look(3, 300, block=slice(38, 88))).lacks
    assert moved.startswith("lacks 0.48 mm² of what stood there at the last look")


@pytest.mark.parametrize("below", [0.1, 0.2])
def test_ink_is_lifted_by_the_map_of_the_layer_below_alone(below: float) -> None:
    """Of a look at mends alone the last map shows the same layer."""
    maps = MapHistory()
    maps.check(*_look(1, 300, top=below))
    at, view = _look(2, 300, block=slice(100, 200))
    view.taken[100:200, 100:200] -= 0.1
    view.image[100:200, 100:200, 1] -= 0.1
    maps.check(at, view)
    at.map = MapCheck()
    image = maps.lift_sunken_ground(at, view)
    lifted = float(np.median(image[110:190, 110:190, 1] - view.image[110:190, 110:190, 1]))
    assert (lifted, at.map.sunk_mm) == pytest.approx(
        (0.09, 0.1) if below == 0.1 else (0.0, 0.0), abs=0.015
    )


# --- a scan of another place, size or spacing is told as that
TO_SCAN = np.array([[1.0, 0, 0, -100], [0, 1, 0, -50], [0, 0, -1, 3], [0, 0, 0, 1]])
"""The scan's corner at x 100, y 50; its first section at z 3."""


def scan(voxel_mm: tuple[float, float, float], shape: tuple[int, int, int]) -> Scan:
    empty = np.zeros(shape, np.uint8)
    return Scan(empty, voxel_mm, 1.0, False, "linear", "oct", True, Path("painted"))


def lines() -> ExpectedLines:
    y = np.linspace(51.0, 54.0, 7)
    start = np.column_stack([np.full(7, 101.0), y, np.full(7, 2.0)])
    each, fresh = np.arange(7), np.ones(7, dtype=np.bool_)
    return ExpectedLines(start, start + [4.0, 0, 0], np.full(7, 0.2), each, each, fresh)


@pytest.mark.parametrize(
    ("voxel_mm", "shape", "share"),
    [
        ((0.02, 0.03, 0.012), (100, 200, 200), "40%"),  # too narrow a spacing
        ((0.02, 0.03, 0.03), (100, 60, 200), "29%"),  # a third of the sections
        ((0.005, 0.03, 0.03), (100, 200, 200), "0%"),  # not as deep
    ],
)
def test_a_scan_of_other_spacing_or_size_says_what_it_holds(
    voxel_mm: tuple[float, float, float], shape: tuple[int, int, int], share: str
) -> None:
    with pytest.raises(DeviceError, match="of the lines lie in the scan: they are at x 101") as no:
        refuse_elsewhere(ScanSize.from_scan(scan(voxel_mm, shape), TO_SCAN), lines())
    assert str(no.value).startswith(share)
    assert "correct the voxel size" in str(no.value)


def test_a_scan_that_tells_nothing_of_another_spacing_than_the_last_is_refused() -> None:
    sizes = [
        ScanSize.from_scan(scan((0.02, y, 0.03), (100, 200, 200)), TO_SCAN) for y in (0.03, 0.06)
    ]
    assert (
        InspectionState()
        .size_words(sizes[1])
        .startswith("the scan has 200 × 200 × 100 voxels of 30 × 60")
    )
    known = InspectionState(None, sizes[0].voxel_mm, sizes[0].words)
    assert known.size_words(sizes[0]).startswith("the scan has")
    with pytest.raises(DeviceError, match=r"30 × 60 × 20 .* the last one that did had .* 30 × 30"):
        known.size_words(sizes[1])
