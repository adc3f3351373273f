import base64
import io
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from registration.report import ReportError
from registration.report.gcode import (
    Act,
    GcodePage,
    Layers,
    draw_layer,
    layer_sums,
    write_gcode_html,
)
from registration.report.gcode import chunks as chunk_module
from registration.report.gcode import page as page_module
from registration.report.gcode.bands import band_outlines
from registration.report.gcode.chunks import COLUMNS, pack_job
from registration.report.gcode.colouring import colourings
from tests.slower import first_of

from .columns import unpacked
from .gcode_sample import WRITE, layered_job, make_job, passes_job


def rows_of(chunk):
    return unpacked(chunk.data, chunk.rows, COLUMNS)


def test_a_piece_says_every_move_where_it_is():
    job = layered_job()
    packed = pack_job(job, True)
    (chunk,) = packed.chunks
    rows = rows_of(chunk)
    places = np.column_stack([rows[axis] for axis in "xyz"])
    act, width = rows["act"], rows["width"]
    assert act.tolist() == [Act.JUMP, *job.act.tolist()]
    assert places[1:] == pytest.approx(job.end)
    assert places[0] == pytest.approx(job.start[0])
    assert rows["line"].tolist() == [11, *job.line.tolist()]
    assert rows["speed"] == pytest.approx(20.0)
    assert set(rows["vessel"]) == {-1}
    assert width[act == WRITE] == pytest.approx(0.5)
    assert np.isnan(width[act != WRITE]).all()
    assert rows["kind"][1:].tolist() == job.kind.tolist()
    assert rows["dose"][rows["dose"] != 0].tolist() == [-0.25, 0.5]
    text = zlib.decompress(base64.b64decode(chunk.text)).decode().split("\n")
    assert text[0] == "G1 line 11"
    assert text[1] == ""
    assert text[2:] == [f"G1 line {k}" for k in range(12, 21)]
    assert packed.first.tolist() == [0, 5]
    assert packed.last.tolist() == [5, 11]


@given(st.data())
def test_moves_of_layers_in_any_order_keep_their_ends(data):
    count = data.draw(st.integers(1, 30))
    least = data.draw(st.integers(1, 12))
    layer = data.draw(st.lists(st.integers(0, 4), min_size=count, max_size=count))
    seed = data.draw(st.integers(0, 1000))
    places = np.round(np.random.default_rng(seed).uniform(-50, 50, (count + 1, 3)), 3)
    layers = Layers(False, np.arange(5.0), np.ones(5))
    job = make_job(places, [WRITE] * count, layer, layers)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunk_module, "MOVES_A_CHUNK", least)
        packed = pack_job(job, False)
    found = []
    pieces = [rows_of(chunk) for chunk in packed.chunks]
    for k in range(5):
        rows = pieces[packed.chunk[k]]
        for i in range(packed.first[k], packed.last[k]):
            if rows["act"][i] != Act.JUMP:
                ends = [[rows[axis][j] for axis in "xyz"] for j in (i - 1, i)]
                found.append((rows["line"][i] - 11, k, ends))
    assert sorted(move for move, _, _ in found) == list(range(count))
    for move, k, ends in found:
        assert layer[move] == k
        assert ends == pytest.approx(np.array([job.start[move], job.end[move]]))


def test_sums_of_layers():
    sums = layer_sums(layered_job())
    assert sums["moves"].tolist() == [4, 6]
    assert sums["written"].tolist() == [2, 2]
    assert sums["lines"].tolist() == [2, 2]
    assert sums["ul"].tolist() == [1, 1]
    assert sums["way_mm"].tolist() == [20, 20]
    assert sums["time_s"].tolist() == [1, 1.5]
    assert sums["first_line"].tolist() == [11, 15]
    assert sums["last_line"].tolist() == [14, 20]


def test_colourings_say_only_what_is_known():
    assert [c.key for c in colourings(layered_job())] == ["width", "kind", "speed", "order"]
    nameless = replace(layered_job(), kind=np.full(10, -1))
    assert [c.key for c in colourings(nameless)] == ["width", "speed", "order"]
    unknown = replace(nameless, width_mm=np.full(10, np.nan))
    assert [c.key for c in colourings(unknown)] == ["speed", "order"]
    keys = [c.key for c in colourings(passes_job())]
    assert keys == ["height", "width", "kind", "speed", "order", "vessel"]


def test_the_rounding_of_widths_doesnt_fill_the_scale():
    job = layered_job()
    width = np.where(job.writes, 0.15 + 1e-4 * np.arange(10), np.nan)
    low, high = colourings(replace(job, width_mm=width))[0].limits
    assert high - low == pytest.approx(0.015, rel=0.05)


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


def test_a_page_says_what_it_leaves_out_and_refuses_too_many_moves(tmp_path, monkeypatch):
    path = tmp_path / "a.html"
    monkeypatch.setattr(page_module, "MAX_TEXT_BYTES", 20)
    write_gcode_html(path, layered_job(), GcodePage("width"))
    assert "lines are told by number" in path.read_text(encoding="utf-8")
    monkeypatch.setattr(page_module, "MAX_MOVES", 5)
    path.unlink()
    with pytest.raises(ReportError, match="10 moves"):
        write_gcode_html(path, layered_job(), GcodePage("width"))
    assert not path.exists()


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


def test_pieces_of_two_colours_overlap_only_within_the_turn():
    start, end = np.array([[-2.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]])
    outlines, _ = band_outlines(start, end, np.full(2, 1.0), np.zeros(2, int), np.arange(2))
    _, left = filled(outlines[:1])
    _, right = filled(outlines[1:])
    assert not (left & right).any()


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


def test_picture_of_a_square_layer_is_928_for_1040():
    places = [(0, 0, 1), (4, 0, 1), (4, 4, 1), (0, 4, 1)]
    layers = Layers(False, np.array([1.0]), np.array([0.1]))
    job = make_job(places, [WRITE] * 3, [0, 0, 0], layers)
    picture = draw_layer(job, 0, colourings(job)[0], 1040, False)
    assert Image.open(io.BytesIO(picture)).size == (1040, 928)


def test_picture_of_passes_shows_those_before_and_no_later_one():
    job = passes_job()
    colouring = next(c for c in colourings(job) if c.key == "vessel")
    inked = []
    for k in range(3):
        image = Image.open(io.BytesIO(draw_layer(job, k, colouring, 520, False))).convert("RGB")
        near = np.abs(np.asarray(image).astype(int) - 255).sum(axis=2) > 90
        inked.append(near.sum())
    assert len(set(inked)) == 3
