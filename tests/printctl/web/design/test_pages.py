"""Design page in a real browser: from a new recipe to its network and layers."""

from __future__ import annotations

import io
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image, ImageChops, ImageStat
from playwright.sync_api import expect

from design.network_files.csv_format import write_network_csv
from printctl.recipe.load import STARTER
from printctl.run_folder.manifest import Manifest, StageRecord
from printctl.web.design import run_views as views
from printctl.web.design.recipe_text import read_text
from tests.printctl.web.serving import Process, server_process
from tests.printctl.web.shell.browsers import LOOKS, serious, shown
from tests.printctl.web.shell.dialogs import serious_in_dialog
from tests.system.cli import called as printctl
from tests.system.forks import FORK, of_fork

pytestmark = pytest.mark.browser
STAND_IN = """<!doctype html><html lang="en"><head><title>Stand-in</title></head><body><script>
addEventListener("message", (event) => { document.body.dataset.told = event.data.view; });
document.body.dataset.state = "ready";
</script></body></html>"""
"""In place of a network in 3D, which costs ten seconds of a core to draw."""
_ASK = "fetch('/api/v1/runs').then(() => 'reached', () => 'refused')"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("design") / "workspace"
    (folder / "recipes").mkdir(parents=True)
    write_network_csv(folder / "recipes" / "fork.csv", FORK)
    return folder


@pytest.fixture(scope="module")
def served(workspace: Path) -> Iterator[Process]:
    with server_process(workspace) as server:
        yield server


@pytest.fixture(scope="module")
def made(workspace: Path) -> Path:
    """A design as `printctl run` makes it; clicks make one in `tests/system/test_operator_page`."""
    recipe = workspace / "recipes" / "one.yaml"
    recipe.write_text(of_fork(STARTER.read_text()))
    folder = workspace / "runs" / "one"
    done = printctl("run", str(recipe), "--out", str(folder), "--until", "lumens", cwd=workspace)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def two(workspace: Path) -> tuple[str, str]:
    """Two runs whose pages of the network are there already."""
    names = ("left", "right")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(views, "_make", lambda sort, run, page: page.write_text(STAND_IN))
        for name in names:
            (workspace / "recipes" / f"{name}.yaml").write_text(of_fork(STARTER.read_text()))
            folder = workspace / "runs" / name
            folder.mkdir(parents=True)
            grown = StageRecord("key", {}, {"vessels": 3}, 1.0, 1.0)
            Manifest(folder, {"recipe": {}}, {"vasculature": grown}).save()
            write_network_csv(folder / "network.csv", FORK)
            views.network_page(folder, workspace / ".printctl" / "pages")
    return names


def test_the_page_invites_to_a_recipe_that_is_begun_and_mended(
    served: Process, browser: Any
) -> None:
    page = shown(browser, f"{served.url}/design")
    page.get_by_text("Choose a recipe, make a new one, or begin with an example.").wait_for()
    assert not page.get_by_label("Recipe as YAML").is_visible()
    assert serious(page) == []
    _begin(page, "New recipe", "first")
    assert page.get_by_label("Recipe as YAML").is_visible()
    assert not page.get_by_text("Choose a recipe, make a new one").is_visible()
    text = page.get_by_label("Recipe as YAML")
    text.fill(of_fork(text.input_value()))
    page.get_by_text("toolpath", exact=True).first.click()
    layer = page.get_by_label("layer (µm)", exact=True)
    expect(layer).to_have_value("150")  # what is typed is taken up a moment later
    layer.fill("1")
    page.get_by_text("must be at least 10 (is 1)", exact=True).wait_for()
    page.get_by_text("first: 1 to mend · saved").wait_for()
    assert "layer_um: 1, line_um: 400}" in text.input_value()
    page.wait_for_timeout(500)  # the hint fades away under the error
    assert serious(page) == []
    layer.fill("150")
    page.get_by_text("first: ready to be made · saved").wait_for()


def _begin(page: Any, button: str, name: str) -> None:
    page.get_by_role("button", name=button, exact=True).click()
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_role("button", name="Make", exact=True).click()
    page.get_by_text(re.compile(f"^{name}: ready to be made")).wait_for()


def test_networks_beside_each_other_are_shut_in_and_hear_of_each_others_view(
    served: Process, browser: Any, two: tuple[str, str]
) -> None:
    page = shown(browser, f"{served.url}/design?recipe=left&tab=compare")
    for name in two:
        inside = page.frame_locator(f'iframe[title="Network of {name}"]')
        inside.locator("body[data-state=ready]").wait_for()
    frames = [page.query_selector(f'iframe[title="Network of {name}"]') for name in two]
    one, other = (frame.content_frame() for frame in frames)
    assert one.evaluate("origin") == "null"
    assert one.evaluate(_ASK) == "refused"
    one.evaluate("parent.postMessage({ printctl: 'view', view: [1, 2] }, '*')")
    other.locator("body[data-told='1,2']").wait_for()
    assert one.locator("body[data-told]").count() == 0


@pytest.mark.slow
def test_a_design_is_seen(served: Process, browser: Any, made: Path) -> None:
    page = shown(browser, f"{served.url}/design?recipe=one&tab=look")
    page.get_by_text("Ink needed").wait_for()
    # Drawn twice for a moment, until the theme is known.
    network = page.frame_locator('iframe[title="Network in 3D of one"]').first
    network.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    names = network.locator("select option").all_inner_texts()
    assert {"Radius / mm", "Lumen error by the G-code / µm"} <= set(names)
    page.get_by_role("button", name="Layers and passes").click()
    layers = page.frame_locator('iframe[title="Layers and passes of one"]').first
    layers.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    slider = layers.locator("input[type=range]").first
    before = slider.input_value()
    slider.focus()
    slider.press("ArrowRight")
    assert slider.input_value() != before
    assert serious(page) == []


@pytest.mark.slow
def test_networks_that_are_compared_turn_together(
    served: Process, browser: Any, made: Path
) -> None:
    shutil.copytree(made, made.with_name("two"))
    page = shown(browser, f"{served.url}/design?recipe=one&tab=compare")
    for name in ("one", "two"):
        frame = page.frame_locator(f'iframe[title="Network of {name}"]')
        frame.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    other = frame.locator("#stage canvas")
    page.wait_for_timeout(1000)
    before = other.screenshot()
    buttons = page.frame_locator('iframe[title="Network of one"]')
    buttons.get_by_role("button", name="Top", exact=True).click()
    page.wait_for_timeout(1000)
    turned = _differ(before, other.screenshot())
    buttons.get_by_role("button", name="Oblique", exact=True).click()
    page.wait_for_timeout(1000)
    assert turned > 5 * _differ(before, other.screenshot())


def _differ(one: bytes, other: bytes) -> float:
    """Mean difference of two pictures, 0 to 255."""
    seen = [Image.open(io.BytesIO(data)).convert("L") for data in (one, other)]
    return float(ImageStat.Stat(ImageChops.difference(*seen)).mean[0])


@pytest.mark.slow
@pytest.mark.parametrize(("viewport", "colours"), LOOKS[1:])
def test_the_page_fits_small_screens(
    served: Process, browser: Any, made: Path, viewport: dict[str, int], colours: str
) -> None:
    for tab in ("recipe", "make", "look", "compare"):
        url = f"{served.url}/design?recipe=one&tab={tab}"
        page = shown(browser, url, viewport=viewport, color_scheme=colours)
        page.wait_for_timeout(1500)
        assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
        assert serious(page) == []
        page.close()


@pytest.mark.slow
def test_a_file_is_imported_and_chosen_in_the_form(
    served: Process, browser: Any, workspace: Path, tmp_path: Path
) -> None:
    given = STARTER.read_text().replace(
        "\n  design: planar_four_vessel", " {network: missing.csv, unit: mm}#"
    )
    (workspace / "recipes" / "given.yaml").write_text(given)
    vessels = tmp_path / "vessels.csv"
    write_network_csv(vessels, FORK)
    page = shown(browser, f"{served.url}/design?recipe=given")
    page.get_by_text(re.compile("^given: 1 to mend")).wait_for()
    page.get_by_role("button", name="Import").click()
    page.locator("input[type=file]").set_input_files(str(vessels))
    page.get_by_text("vessels.csv can be named in recipes now").wait_for()
    page.get_by_text("vasculature", exact=True).first.click()
    page.get_by_label("network", exact=True).click()
    page.get_by_role("option", name="vessels.csv").click()
    page.get_by_text(re.compile("^given: ready to be made")).wait_for()
    assert "network: vessels.csv" in (workspace / "recipes" / "given.yaml").read_text()


def test_markup_in_a_file_s_name_is_shown_as_text(
    served: Process, browser: Any, tmp_path: Path
) -> None:
    page = shown(browser, f"{served.url}/design")
    page.get_by_role("button", name="Import").click()
    page.get_by_role("button", name="Choose a file").wait_for()
    assert serious_in_dialog(page) == []
    bad = tmp_path / "<img src=x onerror=window.bad=1>.yaml"
    bad.write_text("schema: 1\nname: <img src=x onerror=window.bad=1>\n")
    page.locator("input[type=file]").set_input_files(str(bad))
    page.get_by_text(re.compile("to mend")).first.wait_for()
    page.get_by_text(re.compile("<img src=x")).first.wait_for()
    assert page.evaluate("window.bad") is None


@pytest.mark.slow
def test_inlets_are_picked_on_the_tissue(served: Process, browser: Any, workspace: Path) -> None:
    grown = "tissue: {shape: block, size_mm: [16, 8, 3]}\nvasculature: {grow: tree, terminals: 20}"
    (workspace / "recipes" / "grown.yaml").write_text(f"schema: 1\nname: grown\n{grown}\n")
    page = shown(browser, f"{served.url}/design?recipe=grown")
    page.get_by_text("Pick inlets on the tissue").click()
    tissue = page.frame_locator('iframe[title="Tissue of grown"]')
    tissue.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    tissue.get_by_role("button", name="Top", exact=True).click()
    canvas = tissue.locator("#stage canvas")
    for place, told in (((0.4, 0.5), "a further inlet: "), ((0.6, 0.5), "a further inlet: ")):
        size = canvas.bounding_box()
        canvas.click(position={"x": place[0] * size["width"], "y": place[1] * size["height"]})
        page.get_by_text(re.compile(f"^{told}.* 3.000 mm$")).wait_for()
        page.wait_for_timeout(500)
    said = read_text((workspace / "recipes" / "grown.yaml").read_text())["vasculature"]["inlets"]
    assert [one["at_mm"][2] for one in said] == [3.0, 3.0]
    assert said[0]["at_mm"][0] < 8.0 < said[1]["at_mm"][0]
    page.get_by_text("grown: ready to be made · saved").wait_for()
    assert serious(page) == []
