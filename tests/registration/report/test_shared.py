"""Shared parts of pages and figures: head, scripts, small multiples, caching."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from registration.report import all_figures, network_page, write_report_html
from registration.report import page as page_module
from registration.report.drawing import broken_line, small_multiples
from registration.report.scripts import import_map
from tests.registration.report.sample import planar_network, sample_data

TEMPLATES = Path(network_page.__file__).parent / "templates"
PAGES = ("comparison", "dye", "gcode", "network", "overlay", "report")


@pytest.mark.parametrize("name", PAGES)
def test_every_page_has_the_shared_head_and_no_other(name: str) -> None:
    text = (TEMPLATES / f"{name}.html").read_text(encoding="utf-8")
    assert text.count('{% include "head.html" %}') == 1
    assert "<meta" not in text


def test_a_page_holds_the_modules_that_its_entry_needs_and_no_other() -> None:
    flat = json.loads(import_map('import "overlay/main";'))["imports"]
    assert list(flat) == ["overlay/main", "viewer/page"]
    page = (TEMPLATES.parent / "viewer" / "page.js").read_bytes()
    assert flat["viewer/page"].endswith(base64.b64encode(page).decode())
    solid = json.loads(import_map())["imports"]
    assert {"three", "three/orbit", "viewer/view"} <= set(solid)


@pytest.mark.parametrize(("count", "rows", "columns"), [(1, 1, 1), (2, 1, 2), (3, 1, 3), (8, 3, 3)])
def test_small_multiples_stand_in_rows_with_the_gaps_asked_for(
    count: int, rows: int, columns: int
) -> None:
    figure, axes, found = small_multiples(count, 1.9, (0.8, 0.7))
    assert (len(axes), found) == (count, columns)
    wide, high = figure.get_size_inches()
    boxes = [one.get_position() for one in axes]
    if columns > 1:
        assert (boxes[1].x0 - boxes[0].x1) * wide == pytest.approx(0.8)
    if rows > 1:
        assert (boxes[0].y0 - boxes[columns].y1) * high == pytest.approx(0.7)
    assert min(box.x0 for box in boxes) * wide == pytest.approx(0.7)
    assert max(box.x1 for box in boxes) <= 1
    assert sum(one.axison for one in figure.axes) == count


def test_a_line_breaks_where_a_section_is_missing() -> None:
    along = np.array([0.0, 0.1, 0.2, 0.5, 0.6])
    x, y = broken_line(along, np.arange(5.0))
    assert np.flatnonzero(np.isnan(x)).tolist() == [3]
    assert np.flatnonzero(np.isnan(y)).tolist() == [3]
    assert broken_line(along[:2], along[:2])[0].tolist() == [0.0, 0.1]


def test_what_is_drawn_already_isnt_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, network = sample_data(), planar_network()
    picture = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"/>'
    write_report_html(tmp_path / "a.html", data, [], network, {"toolpath/Layer": picture})
    drawn = all_figures(data, network, {"toolpath/Layer": picture})
    assert list(drawn)[-1] == "toolpath/Layer"
    names = [name for name in vars(page_module) if name.endswith("_figure")]
    for name in set(names) - {"inline_figure", "profile_figure", "layer_deviation_figure"}:
        monkeypatch.setattr(page_module, name, lambda *_: pytest.fail("drawn again"))
    write_report_html(tmp_path / "b.html", data, [], network, drawn)
    assert (tmp_path / "b.html").read_bytes() == (tmp_path / "a.html").read_bytes()
