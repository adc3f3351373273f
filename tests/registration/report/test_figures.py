import numpy as np
import pytest
from lxml import etree, html

from registration.report import (
    diameter_figure,
    histogram_figure,
    network_figure,
)
from registration.report.gcode import layer_figure
from registration.report.gcode.colouring import colourings
from registration.report.svg import inline_svg

from .gcode_sample import layered_job
from .sample import planar_network

MEANS = [
    {"vessel": 0, "designed_um": 400.0, "value_um": 10.0},
    {"vessel": "$b_2$", "designed_um": 500.0, "value_um": 100.0, "u_um": 8.0, "lower_um": -30.0,
     "upper_um": 90.0, "decision": "fail"},
    {"vessel": 2, "designed_um": 450.0, "value_um": -31.0, "u_um": 8.0, "lower_um": -30.0,
     "decision": "undecided"},
]  # fmt: skip


def every_figure() -> dict[str, bytes]:
    network = planar_network()
    job = layered_job()
    return {
        "histogram": histogram_figure([-50, 0, 50, 100], [1, 3, 2]),
        "diameters": diameter_figure(MEANS),
        "network": network_figure(network, np.arange(14.0), "flow / mL/min"),
        "layer": layer_figure(job, 0, colourings(job)[0]),
    }


@pytest.fixture(scope="module")
def twice() -> tuple[dict[str, bytes], dict[str, bytes]]:
    return every_figure(), every_figure()


@pytest.mark.parametrize("name", ["histogram", "diameters", "network", "layer"])
def test_a_figure_is_svg_and_reproducible(twice, name):
    first, second = twice[0][name], twice[1][name]
    assert etree.fromstring(first).tag == "{http://www.w3.org/2000/svg}svg"
    assert first == second


def test_diameters_are_counted_by_their_decision_and_allowed_what_is_theirs() -> None:
    found = every_figure()["diameters"].decode()
    for said in ("measured (1)", "undecided (1)", "fail (1)"):
        assert said in found
    assert "pass" not in found


def test_inlined_drawings_follow_the_theme_and_keep_their_ids_apart() -> None:
    picture = every_figure()["diameters"]
    pages = [html.fromstring(inline_svg(picture, "c", prefix)) for prefix in ("a-", "b-")]
    first, second = (set(page.xpath("//@id")) for page in pages)
    assert first
    assert not first & second
    for page, ids in zip(pages, (first, second), strict=True):
        assert {ref[1:] for ref in page.xpath("//@href")} <= ids
    assert "var(--ink)" in inline_svg(picture, "c", "a-")
    assert "#1c2126" not in inline_svg(picture, "c", "a-")
