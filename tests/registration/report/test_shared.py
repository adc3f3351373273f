"""Shared parts of pages and figures: head, scripts, small multiples, caching."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from registration.report import all_figures, network_page, write_report_html
from registration.report import page as page_module
from registration.report.scripts import import_map, module_map
from tests.registration.report.sample import planar_network, sample_data

TEMPLATES = Path(network_page.__file__).parent / "templates"
PAGES = ("comparison", "dye", "gcode", "network", "overlay", "report")


@pytest.mark.parametrize("name", PAGES)
def test_every_page_has_the_shared_head_and_no_other(name: str) -> None:
    text = (TEMPLATES / f"{name}.html").read_text(encoding="utf-8")
    assert text.count('{% include "head.html" %}') == 1
    assert "<meta" not in text


def test_module_map_names_what_a_page_imports(tmp_path: Path) -> None:
    (tmp_path / "main.js").write_text("1")
    found = json.loads(module_map(("theme",), "own", tmp_path))["imports"]
    assert sorted(found) == ["own/main", "report/theme"]
    assert found["own/main"] == "data:text/javascript;base64,MQ=="
    assert found["report/theme"] == json.loads(import_map())["imports"]["report/theme"]


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
