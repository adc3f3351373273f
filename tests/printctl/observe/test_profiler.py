"""A laser profiler's frame and files, as an observer opens them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import yaml

from benchmarks.checkers.profiler_painter import profiled
from benchmarks.observe_laser import expected
from printctl.errors import UsageError
from printctl.observe.devices import DeviceError
from printctl.observe.views import View, open_view, read_profiler_frame, refuse_other_height


def write_frame(path: Path, **changes: object) -> Path:
    path.write_text(yaml.safe_dump({"printer_to_scan": np.eye(4).tolist(), **changes}))
    return path


def test_a_frame_says_what_the_files_dont(tmp_path: Path) -> None:
    bare = read_profiler_frame(write_frame(tmp_path / "a.yaml"))
    assert (bare.pixel_mm, bare.count_mm, bare.lost) == (None, 1.0, None)
    path = write_frame(
        tmp_path / "b.yaml", pixel_mm=[0.02, 0.05], count_mm=0.001, lost=-32768, size=[400, 300]
    )
    full = read_profiler_frame(path)
    assert (full.pixel_mm, full.count_mm, full.lost) == ((0.02, 0.05), 0.001, -32768.0)
    assert (bare.size, full.size) == (None, (400, 300))


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


def test_a_profilers_file_is_opened_by_its_frame_and_a_simulated_ones_by_its_own(
    tmp_path: Path,
) -> None:
    map_ = profiled(1, "plate")
    frame = write_frame(
        tmp_path / "frame.yaml", printer_to_scan=map_.to_map.tolist(), pixel_mm=[map_.px] * 2
    )
    told, own = (opened(tmp_path, map_.heights, one) for one in (frame, None))
    np.testing.assert_array_equal(told.image, own.image)
    assert told.size is not None
    assert "µm over the layer's top along the lines" in told.size.words
    assert told.hidden is not None
    assert told.hidden.any()
    assert told.shown is not None
    assert told.shown.shape == (*map_.heights.shape, 3)
    np.testing.assert_array_equal(told.taken, map_.heights)


def test_a_map_of_another_place_or_without_a_spacing_is_told(tmp_path: Path) -> None:
    map_ = profiled(1, "plate")
    with pytest.raises(DeviceError, match=r"pixel_mm: \[x, y\]"):
        opened(tmp_path, map_.heights, write_frame(tmp_path / "frame.yaml"))
    elsewhere = write_frame(tmp_path / "frame.yaml", pixel_mm=[0.02, 0.02])
    with pytest.raises(DeviceError, match="0% of the lines lie in the scan"):
        opened(tmp_path, map_.heights, elsewhere)


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
