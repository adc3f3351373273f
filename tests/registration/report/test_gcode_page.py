import base64
import io
import re
import zlib

import numpy as np
import pytest
from PIL import Image

from registration.report.gcode import (
    Act,
    GcodePage,
    design_outline,
    draw_layer,
    write_gcode_html,
)
from registration.report.gcode.bands import band_outlines
from registration.report.gcode.chunks import pack_job
from registration.report.gcode.colouring import colourings
from tests.slower import first_of

from .gcode_sample import WRITE, layered_job


def unpacked(chunk):
    """A piece's fields, read the slow way."""
    data, n = zlib.decompress(base64.b64decode(chunk.data)), chunk.rows
    at = 0
    fields = []
    for size in (4, 4, 4, 4, 4, 4, 2, 1, 1):
        planes = data[at : at + size * n]
        at += size * n
        fields.append([
            int.from_bytes(bytes(planes[k * n + i] for k in range(size)), "little",
                           signed=size == 4)
            for i in range(n)
        ])  # fmt: skip
    for k in (0, 1, 2, 4):
        fields[k] = np.cumsum(fields[k]).tolist()
    return fields, np.frombuffer(data[at:], "<f4")


def test_a_piece_says_every_move_where_it_is():
    job = layered_job()
    packed = pack_job(job, True)
    (chunk,) = packed.chunks
    (x, y, z, speed, line, vessel, width, act, kind), dose = unpacked(chunk)
    assert act == [Act.JUMP, *job.act.tolist()]
    assert np.column_stack([x, y, z])[1:] / 1e3 == pytest.approx(job.end)
    assert np.array([x[0], y[0], z[0]]) / 1e3 == pytest.approx(job.start[0])
    assert line == [11, *job.line.tolist()]
    assert set(speed) == {20_000}
    assert set(vessel) == {-1}
    assert [w for w, a in zip(width, act, strict=True) if a == WRITE] == [500] * 4
    assert {w for w, a in zip(width, act, strict=True) if a != WRITE} == {65_535}
    assert kind[1:] == (job.kind + 1).tolist()
    assert dose.tolist() == [-0.25, 0.5]
    text = zlib.decompress(base64.b64decode(chunk.text)).decode().split("\n")
    assert text[0] == "G1 line 11"
    assert text[1] == ""
    assert text[2:] == [f"G1 line {k}" for k in range(12, 21)]
    assert packed.first.tolist() == [0, 5]
    assert packed.last.tolist() == [5, 11]


def test_the_same_job_gives_the_same_page_and_hostile_names_stay_text(tmp_path):
    hostile = "</script><script>alert(1)</script>"
    job = layered_job(name=hostile, kinds=(hostile, "b"), notes=(hostile,))
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for path in pages:
        write_gcode_html(path, job, GcodePage("kind", 1))
    text = pages[0].read_text(encoding="utf-8")
    assert text == pages[1].read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert not re.search(r'(src|href)="http', text)


def filled(outlines, size=400, reach=4.0):
    """Share of a square about the origin that is inside outlines, by points."""
    axis = (np.arange(size) + 0.5) / size * 2 * reach - reach
    points = np.array(np.meshgrid(axis, axis)).reshape(2, -1).T
    inside = np.zeros(len(points), bool)
    for outline in outlines:
        for part in outline.to_polygons(closed_only=True):
            inside |= np.asarray(
                type(outline)(part).contains_points(points, radius=0.0), dtype=bool
            )
    return points, inside


def test_a_band_is_what_lies_within_half_its_width_of_the_line():
    start = np.array([[-2.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    end = np.array([[1.0, 0.0], [1.0, 2.0], [-1.0, 1.0]])
    one = np.zeros(3, np.int64)
    for colour in (one, np.array([0, 1, 0])):
        outlines, of = band_outlines(start, end, np.full(3, 0.8), one, colour)
        assert len(outlines) == len(of) == (1 if colour is one else 3)
        points, inside = filled(outlines)
        way = end - start
        along = np.einsum("nkd,kd->nk", points[:, None] - start, way) / (way**2).sum(axis=1)
        foot = start + np.clip(along, 0, 1)[..., None] * way
        near = np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1) < 0.4
        assert (inside != near).mean() < 0.002


@pytest.mark.parametrize("key", first_of(["width", "kind", "speed", "order"], 2))
def test_picture_of_a_layer_has_the_size_that_is_asked_for(key):
    job = layered_job()
    (colouring,) = (c for c in colourings(job) if c.key == key)
    pictures = [draw_layer(job, 1, colouring, 520, True) for _ in range(2)]
    assert pictures[0] == pictures[1]
    image = Image.open(io.BytesIO(pictures[0]))
    # Ten times as wide as high, which is more than a picture follows.
    assert image.size == (520, round(520 * (0.70 * 0.2 + 0.1924)))
    assert image.mode == "P"


# Excess of printed lines over the design's outline.

BOX = np.array([[0.0, 0.7], [10, 0.7], [10, 2.3], [0, 2.3]])
"""Around the lines at y = 1 and 2, which are 0.5 mm wide."""


def test_ink_beyond_the_outline_counts_above_nought_and_short_of_it_below() -> None:
    shifted = BOX + [0.0, 0.1]
    found = design_outline(layered_job(), 0, [shifted])
    (ring,), (beyond,) = found.rings, found.beyond_mm
    middle = 0.5 * (ring[1:] + ring[:-1])
    inner = (middle[:, 0] > 0.5) & (middle[:, 0] < 9.5)
    assert beyond[inner & (middle[:, 1] < 1)] == pytest.approx(0.05)
    assert beyond[inner & (middle[:, 1] > 2)] == pytest.approx(-0.15)
    assert np.linalg.norm(np.diff(ring, axis=0), axis=1).max() < 0.0301


def test_the_picture_shows_where_ink_is_missing() -> None:
    job = layered_job()
    colouring = colourings(job)[0]
    plain = draw_layer(job, 0, colouring, 400, False)
    near = draw_layer(job, 0, colouring, 400, False, design_outline(job, 0, [BOX]))
    off = draw_layer(job, 0, colouring, 400, False, design_outline(job, 0, [BOX + [0.0, 0.1]]))
    assert len({plain, near, off}) == 3
