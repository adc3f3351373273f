"""Scan overlay on G-code, on a block with planted line faults.

The block lies in the scan turned by 90° about the vertical and shifted, in voxels that aren't the
raster's pixels. Five layers of 0.1 mm; lines of 0.2 mm along x; a free strip from y 1.4 to 2.0.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import manifold3d
import numpy as np
import pytest
from numpy.typing import NDArray

from design.geometry.surface import Surface
from kernels.arrays import FloatArray
from registration.errors import AlignmentError, RegistrationError
from registration.overlay import (
    Cutter,
    LayerLines,
    LayerNumbers,
    LayerStatus,
    Limits,
    Raster,
    align_pose,
    measure_layer,
    overlay_csv,
    overlay_dict,
    reached,
    read_pose,
    statuses,
)
from registration.scan import Scan
from registration.segmentation import GelField, Segmentation, Strength
from tests.registration.parts import solid

Gel = Callable[[FloatArray, FloatArray, FloatArray], NDArray[np.bool_]]

LONG, WIDE, HEIGHT, LINE, COUNT = 4.0, 3.0, 0.1, 0.2, 5
FREE = (1.4, 2.0)
VOXEL = 0.02
ROW_Y = np.array([y for y in np.arange(0.1, WIDE, LINE) if not FREE[0] < y < FREE[1]])
STRIP = np.array([[0.0, FREE[0]], [LONG, FREE[0]], [LONG, FREE[1]], [0.0, FREE[1]]])
SCAN_TO_PART = np.array([[0, -1, 0, 4.3], [1, 0, 0, -0.35], [0, 0, 1, -0.21], [0, 0, 0, 1.0]])
LIMITS = Limits(0.04, 0.02, 0.05)


def layers() -> tuple[LayerLines, ...]:
    n = len(ROW_Y)
    zero, no = np.zeros(n), np.zeros(n, np.bool_)
    return tuple(
        LayerLines(
            number=k + 1,
            low_mm=k * HEIGHT,
            high_mm=(k + 1) * HEIGHT,
            start=np.column_stack([zero, ROW_Y]),
            end=np.column_stack([zero + LONG, ROW_Y]),
            width_mm=zero + LINE,
            line=np.arange(n) * 2 + 10 + 100 * k,
            joined=no,
            closed=no,
            travel=np.zeros((0, 2, 2)),
        )
        for k in range(COUNT)
    )


def block(x: FloatArray, y: FloatArray, z: FloatArray) -> NDArray[np.bool_]:
    body = (x >= 0) & (x <= LONG) & (y >= 0) & (y <= WIDE) & (z >= 0) & (z <= COUNT * HEIGHT)
    return np.asarray(body & ~((y > FREE[0]) & (y < FREE[1])))


def scanned(gel: Gel, planes: slice = slice(None), lit: float | None = None) -> Cutter:
    """A cutter over a scan of that gel, of which only some planes are in the file."""
    shape = np.ceil(np.array([0.94, 4.6, 3.7]) / VOXEL).astype(int)
    z, y, x = (VOXEL * np.arange(n) for n in shape)
    part = np.stack(np.broadcast_arrays(x, y[:, None], z[:, None, None]), axis=-1)
    part = part @ SCAN_TO_PART[:3, :3].T + SCAN_TO_PART[:3, 3]
    values = gel(part[..., 0], part[..., 1], part[..., 2]).astype(np.float32)[planes]
    pose = SCAN_TO_PART.copy()
    pose[2, 3] += VOXEL * (planes.start or 0)
    scan = Scan(
        1000 * values, (VOXEL,) * 3, 1.0, False, "linear", "microct", False, Path("made.tif")
    )
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL), np.zeros(3), 0.02)
    strength = None
    if lit is not None:
        # Light comes from below here (depth up): what is deeper lies higher in the part.
        height = pose[2, 3] + VOXEL * np.arange(len(values))
        signal = values * (height < lit)[:, None, None]
        strength = Strength(
            np.ascontiguousarray(signal, np.float32), 0.1, signal.astype(np.float16)
        )
        scan = replace(scan, depth_down=True)
    none = np.zeros((0, 3))
    found = Segmentation(
        field, Surface(none, none.astype(np.int32)), none, np.zeros(0, bool), 10.0, strength
    )
    return Cutter(scan, found, pose)


def measured(cutter: Cutter) -> list[LayerNumbers]:
    lines = layers()
    raster = Raster.over(lines, LINE)
    lumen = raster.inside([STRIP])
    return [
        measure_layer(one, lumen, cutter.cut(raster, one.middle_mm), raster, LIMITS)
        for one in lines
    ]


def test_a_print_as_written_shows_nothing() -> None:
    numbers = measured(scanned(block))
    assert statuses(numbers) == [LayerStatus.PRINTED] * COUNT
    for one in numbers:
        assert one.written_mm2 == pytest.approx(LONG * (WIDE - 0.6), rel=0.01)
        assert one.free_mm2 == pytest.approx(LONG * 0.6, rel=0.02)
        assert one.gel_in_written is not None
        assert one.gel_in_written > 0.98
        assert one.gel_in_free is not None
        assert one.gel_in_free < 0.04
        assert one.gaps == ()
        assert one.blobs == ()


def test_a_missing_line_is_found_at_its_place_with_its_line_of_the_file() -> None:
    def gel(x: FloatArray, y: FloatArray, z: FloatArray) -> NDArray[np.bool_]:
        gone = (z > 0.2) & (z < 0.3) & (y > 0.6) & (y < 0.8) & (x > 1) & (x < 3)
        return np.asarray(block(x, y, z) & ~gone)

    numbers = measured(scanned(gel))
    assert [len(one.gaps) for one in numbers] == [0, 0, 1, 0, 0]
    gap = numbers[2].gaps[0]
    assert gap.area_mm2 == pytest.approx(2 * LINE, rel=0.15)
    assert gap.width_mm == pytest.approx(LINE, abs=0.04)
    assert gap.at_mm[1] == pytest.approx(0.7, abs=0.03)
    assert gap.low_mm[0] == pytest.approx(1.0, abs=0.05)
    assert gap.high_mm[0] == pytest.approx(3.0, abs=0.05)
    assert numbers[2].gap_lines[0].tolist() == [10 + 200 + 2 * 3]
    written = numbers[2].gel_in_written
    assert written == pytest.approx(1 - 2 * LINE / (LONG * (WIDE - 0.6)), abs=0.01)


def test_gel_in_a_lumen_is_found_at_its_place_and_a_wall_a_little_off_is_not() -> None:
    def gel(x: FloatArray, y: FloatArray, z: FloatArray) -> NDArray[np.bool_]:
        bead = (x - 2.5) ** 2 + (y - 1.7) ** 2 + (z - 0.15) ** 2 < 0.2**2
        narrow = (y > FREE[0]) & (y < FREE[0] + 0.03) & (x > 0) & (x < LONG)
        return np.asarray(block(x, y, z) | ((bead | narrow) & (z > 0) & (z < 0.5)))

    numbers = measured(scanned(gel))
    blob = numbers[1].blobs[0]
    assert len(numbers[1].blobs) == 1
    assert blob.at_mm == pytest.approx((2.5, 1.7), abs=0.04)
    assert blob.area_mm2 == pytest.approx(np.pi * 0.2**2, rel=0.15)
    # The bead reaches 0.13 mm out at the middles of its neighbours, and no further.
    assert [len(one.blobs) for one in numbers] == [1, 1, 1, 0, 0]
    assert all(one.gaps == () for one in numbers)
    assert numbers[4].gel_in_free == pytest.approx(0.03 / 0.6, abs=0.03)


def test_a_half_printed_part_has_layers_not_printed_and_none_that_failed() -> None:
    numbers = measured(scanned(lambda x, y, z: np.asarray(block(x, y, z) & (z < 0.3))))
    found = statuses(numbers)
    assert found == [LayerStatus.PRINTED] * 3 + [LayerStatus.NOT_PRINTED] * 2
    said = overlay_dict(numbers[4], found[4])
    assert said["status"] == "not printed"
    assert said["gap_count"] is None
    assert said["gaps"] is None


def test_a_layer_under_way_is_told_by_where_its_gel_ends() -> None:
    def gel(x: FloatArray, y: FloatArray, z: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(block(x, y, z) & (z < 0.3) & ((z < 0.2) | (y < 1.0)))

    numbers = measured(scanned(gel))
    # Five lines lie below y = 1.
    assert reached(numbers[2]) == 5
    assert reached(numbers[1]) is None


GOOD = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1.01, 3], [0, 0, 0, 1]]


def test_a_pose_is_read_from_a_run_and_from_register(tmp_path: Path) -> None:
    path = tmp_path / "registration.json"
    path.write_text(json.dumps({"scaled_scan_to_part": GOOD, "ambiguity": {"flag": True}}))
    assert read_pose(path).matrix.tolist() == GOOD
    assert "ambiguous" in read_pose(path).notes[0]
    path.write_text(json.dumps({"registration": {"transform_scan_to_part": GOOD}}))
    pose = read_pose(path, "rigid")
    assert pose.matrix.tolist() == GOOD
    assert not pose.aligned
    assert str(path) in pose.said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "can't be read: No such file"),
        ("solid part", "isn't JSON"),
        ("[1, 2]", "holds no scaled_scan_to_part"),
        ('{"registration": {"scale": [1, 1, 1]}}', "holds no scaled_scan_to_part"),
        ('{"scaled_scan_to_part": [[1, 2], [3, 4]]}', "4 × 4"),
        ('{"scaled_scan_to_part": [["a"]]}', "4 × 4"),
        (json.dumps({"scaled_scan_to_part": np.zeros((4, 4)).tolist()}), "is no pose"),
        (json.dumps({"scaled_scan_to_part": np.diag([1.0, 1, -1, 1]).tolist()}), "mirrors"),
    ],
)
def test_a_wrong_pose_file_ends_with_the_reason(text, words, tmp_path):
    path = tmp_path / "pose.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(
        RegistrationError, match=r"registration\.json of `printctl register`"
    ) as got:
        read_pose(path)
    assert words in str(got.value)


def test_a_scan_that_can_t_be_aligned_asks_for_a_pose() -> None:
    scan = Scan(
        np.zeros((8, 8, 8)), (VOXEL,) * 3, 1.0, False, "linear", "microct", False, Path("made.tif")
    )
    none = np.zeros((0, 3))
    field = GelField(np.zeros((8, 8, 8), np.float32), 0.5, 1.0, np.ones(3), np.zeros(3), 0.0)
    nothing = Surface(none, none.astype(np.int32))
    bare = Segmentation(field, nothing, none, np.zeros(0, bool), 10.0, None)
    with pytest.raises(AlignmentError, match=r"0 surface points .* give --pose registration\.json"):
        align_pose(scan, bare, solid(manifold3d.Manifold.cube((4.0, 3.0, 0.5))))


def test_what_no_light_reached_or_is_out_of_view_is_not_seen() -> None:
    numbers = measured(scanned(block, lit=0.24))
    assert statuses(numbers)[3:] == [LayerStatus.NOT_SEEN] * 2
    assert statuses(numbers)[0] == LayerStatus.PRINTED
    assert numbers[4].in_view == 1
    # The part's 0 lies 0.21 mm above the first plane: 28 planes reach to 0.33 mm.
    numbers = measured(scanned(block, slice(0, 28)))
    assert statuses(numbers) == [LayerStatus.PRINTED] * 3 + [LayerStatus.NOT_SEEN] * 2
    assert numbers[4].in_view == 0
    assert numbers[4].gel_in_written is None
    row = overlay_csv([overlay_dict(numbers[4], LayerStatus.NOT_SEEN)]).splitlines()[1]
    assert row.startswith("5,0.4,0.5,0.45,not seen,")
    assert row.endswith("," * 9)


def test_a_layer_that_others_lie_on_is_missing() -> None:
    gone = measured(scanned(lambda x, y, z: np.asarray(block(x, y, z) & ((z < 0.2) | (z > 0.3)))))
    found = statuses(gone)
    assert found[2] == LayerStatus.MISSING
    said = overlay_dict(gone[2], found[2])
    assert said["gap_mm2"] == pytest.approx(LONG * (WIDE - 0.6), rel=0.15)
    assert said["gaps"][0]["line_count"] in (5, 7)
