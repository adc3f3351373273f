"""Pages of a job and of its predicted playback."""

import base64
import io
import re
import zlib
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colorbar import Colorbar
from PIL import Image

from report import ReportError, write_report_html
from report.gcode import (
    Act,
    GcodePage,
    Layers,
    draw_layer,
    layer_sums,
    write_gcode_html,
)
from report.gcode import chunks as chunk_module
from report.gcode import page as page_module
from report.gcode.bands import band_outlines
from report.gcode.chunks import COLUMNS, pack_job
from report.gcode.colouring import colourings
from report.play import (
    Limits,
    PlayRows,
    load_played,
    play_section,
    save_played,
    thin_playback,
    write_play_html,
)
from report.play.frame import draw_frame
from report.play.serialise import pack_playback
from report.play.thin import join_stretches
from tests.slower import first_of

from .columns import unpacked, unpacked_table
from .gcode_sample import WRITE, layered_job, make_job, passes_job
from .play_sample import HOSTILE, layered, make_rows, passes


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


def test_a_constant_has_equal_limits_and_one_tick(monkeypatch):
    job = layered_job()
    width = np.where(job.writes, 0.15 + 1e-5 * np.arange(10), np.nan)
    shown = {one.key: one for one in colourings(replace(job, width_mm=width))}
    low, high = shown["width"].limits
    assert low == high == pytest.approx(0.15, rel=1e-3)
    assert shown["width"].extremes == (low, high)
    assert shown["speed"].limits == (20.0, 20.0)
    ticks, draw = [], Colorbar.set_ticks
    monkeypatch.setattr(
        Colorbar, "set_ticks", lambda bar, at, **more: (ticks.append(at), draw(bar, at, **more))
    )
    draw_layer(job, 1, shown["speed"], 520, True)
    assert ticks == [[20.0]]


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


def decoded(data):
    """Columns of a page's rows, the slow way."""
    found = unpacked_table(data["rows"])
    found["place"] = np.column_stack([found[axis] for axis in "xyz"])
    return found


@pytest.mark.parametrize("played", [layered(), passes()], ids=["layers", "passes"])
def test_what_a_page_holds_is_the_prediction(played):
    rows, data = played.rows, pack_playback(played)
    found = decoded(data)
    own = found["planned"] != Act.JUMP
    begins = np.flatnonzero(own) - 1
    for column, wanted, off in (
        (found["place"][own], rows.end, 1e-4),
        (found["place"][begins], rows.start, 1e-4),
        (found["time"][own], rows.end_s, 5e-4),
        (found["time"][begins], rows.begin_s, 5e-4),
        (found["laid"][own], rows.laid_ul, rows.laid_ul[-1] * 5e-7),
        (found["width"][own], rows.width_mm, 5e-4),
        (found["wanted"][own], rows.wanted_mm, 5e-4),
    ):
        np.testing.assert_allclose(column, wanted, atol=1.001 * off)
    assert found["planned"][own].tolist() == rows.act.tolist()
    for name in ("line", "layer", "vessel", "head"):
        assert found[name][own].tolist() == getattr(rows, name).tolist()
    assert np.all(np.diff(found["time"]) >= 0)
    # One where the job begins, and one where the layered job rests for 2 s.
    assert (~own).sum() == (1 if played.passes else 2)


def wave(count, seed=3):
    """A wave of short stretches at an uneven speed, its width growing; a travel in its middle."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 20, count + 1)
    places = np.column_stack([x, np.sin(x), np.zeros(count + 1)])
    times = np.concatenate([[0], np.cumsum(rng.uniform(0.5, 1.5, count))]) * 40 / count
    act = np.full(count, Act.WRITE, np.uint8)
    act[count // 2 : count // 2 + 20] = Act.TRAVEL
    width = np.where(act == Act.WRITE, np.linspace(0.2, 0.3, count), np.nan)
    return make_rows(places, times, act, width_mm=width,
                     layer=(np.arange(count) > 3 * count // 4).astype(int))  # fmt: skip


def test_joined_stretches_keep_way_time_width_and_ink_within_the_limits():
    rows, limits = wave(6000), Limits(0.005, 0.02, 0.004)
    fewer = join_stretches(rows, limits)
    assert len(fewer) < len(rows) / 10
    # No gap, no overlap; nothing is lost.
    assert fewer.begin_s[0] == rows.begin_s[0]
    assert np.array_equal(fewer.begin_s[1:], fewer.end_s[:-1])
    assert fewer.end_s[-1] == rows.end_s[-1]
    assert np.array_equal(fewer.start[1:], fewer.end[:-1])
    assert fewer.laid_ul[-1] == rows.laid_ul[-1]
    at = np.searchsorted(fewer.end_s, (rows.begin_s + rows.end_s) / 2)
    assert np.array_equal(fewer.act[at], rows.act)
    assert np.array_equal(fewer.layer[at], rows.layer)
    writes = rows.act == Act.WRITE
    assert np.abs(fewer.width_mm[at] - rows.width_mm)[writes].max() <= 0.004
    # Where the needle is when a stretch of the prediction ends.
    share = (rows.end_s - fewer.begin_s[at]) / (fewer.end_s - fewer.begin_s)[at]
    place = fewer.start[at] + share[:, None] * (fewer.end - fewer.start)[at]
    assert np.linalg.norm(place - rows.end, axis=1).max() <= 0.02 + 1e-9
    # How far the way is from the wave itself, along the way's normal.
    step = (fewer.end - fewer.start)[at]
    away = rows.end - fewer.start[at]
    across = step[:, 0] * away[:, 1] - step[:, 1] * away[:, 0]
    assert np.abs(across / np.linalg.norm(step, axis=1)).max() <= 0.005 + 1e-9
    length = np.where(writes, rows.way_mm, 0.0)
    area = np.where(fewer.act == Act.WRITE, fewer.width_mm * fewer.way_mm, 0.0)
    assert area.sum() == pytest.approx((np.nan_to_num(rows.width_mm) * length).sum(), rel=1e-3)


def test_a_large_layered_job_is_told_by_line_and_then_by_some_of_its_layers():
    rng = np.random.default_rng(5)
    rows = wave(2000)
    line, layer = np.arange(2000) // 10, np.arange(2000) // 200
    noisy = replace(rows, line=line, layer=layer, width_mm=rng.uniform(0.1, 0.4, 2000),
                    act=np.full(2000, Act.WRITE, np.uint8))  # fmt: skip
    whole = layered(rows=noisy, layer_z_mm=np.arange(10.0))
    assert len(thin_playback(whole, 2000).rows) > 1900
    by_line = thin_playback(whole, 1000)
    assert np.unique(by_line.rows.line).tolist() == list(range(200))
    assert "mean of each line" in by_line.notes[-1]
    own = by_line.rows.line == 7
    mean = np.average(by_line.rows.width_mm[own], weights=by_line.rows.way_mm[own])
    first = noisy.line == 7
    exact = np.average(noisy.width_mm[first], weights=noisy.way_mm[first])
    assert mean == pytest.approx(exact, rel=1e-3)
    least = thin_playback(whole, len(by_line.rows) // 2 + 1)
    assert set(least.rows.layer.tolist()) == {0, 2, 4, 6, 8}
    assert "One layer in 2 is drawn" in least.notes[-1]
    assert least.rows.laid_ul[-1] == noisy.laid_ul[noisy.layer == 8][-1]
    # Passes would leave holes: they are drawn coarser instead.
    coarse = thin_playback(replace(whole, passes=True), 300)
    assert len(coarse.rows) <= 300
    assert set(coarse.rows.layer.tolist()) == set(range(10))


def test_a_file_between_keeps_all(tmp_path):
    played = passes()
    save_played(tmp_path / "a.npz", played)
    save_played(tmp_path / "b.npz", played)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = load_played(tmp_path / "a.npz")
    for one in fields(PlayRows):
        np.testing.assert_array_equal(getattr(again.rows, one.name), getattr(played.rows, one.name))
    assert (again.inks, again.warnings, again.passes) == (played.inks, played.warnings, True)
    (tmp_path / "b.npz").write_bytes(b"no")
    with pytest.raises(ReportError, match="isn't a prediction"):
        load_played(tmp_path / "b.npz")


def test_a_page_asks_for_nothing_and_strange_names_stay_text(tmp_path):
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for path in pages:
        write_play_html(path, passes(notes=(HOSTILE,)), HOSTILE)
    text = pages[0].read_text(encoding="utf-8")
    assert text == pages[1].read_text(encoding="utf-8")
    assert "<script>document" not in text
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//|url\(|@import""", text)


def test_warnings_stand_on_the_track_and_in_the_list(tmp_path):
    write_play_html(tmp_path / "a.html", layered(), "job")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    # 7 s of 9; what has no moment has no mark.
    assert re.findall(r'class="mark" data-time="7.0" style="left:77.778%"', text)
    assert text.count('class="mark"') == 1
    assert re.search(r'data-time="7.0">0:07.0, line 9</button><span>much too thin</span>', text)
    assert re.search(r"whole job</span><span>all of it</span>", text)


def test_a_report_has_a_slider_only_with_a_prediction(tmp_path):
    path = tmp_path / "r.html"
    write_report_html(path, {"recipe": "one"}, [], None)
    without = path.read_text(encoding="utf-8")
    assert "play-viewer" not in without
    assert "play/main" not in without
    write_report_html(path, {"recipe": "one"}, [], None, None, play_section(passes()))
    text = path.read_text(encoding="utf-8")
    assert text.count('id="play-data"') == text.count('id="play-viewer"') == 1
    assert '<a href="#play">' in text
    assert "<script>document" not in text


@pytest.mark.parametrize("played", [layered(), passes()], ids=["layers", "passes"])
def test_the_frame_for_paper_shows_ink(played):
    picture, said = draw_frame(played)
    assert picture == draw_frame(played)[0]
    image = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)
    # 20 % too thin is blue on this scale.
    blue = (image[:, :, 2] - image[:, :, 0] > 60).mean()
    assert blue > 0.01
    assert said.startswith("All 3 passes" if played.passes else "Layer 2 of 2")
