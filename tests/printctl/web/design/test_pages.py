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
from tests.printctl.web.shell.browsers import shown
from tests.system.cli import called as printctl
from tests.system.forks import FORK, of_fork
from tests.waiting import wait_for

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
        patch.setattr(
            views, "run_worker", lambda *words, **said: Path(words[-1]).write_text(STAND_IN)
        )
        for name in names:
            (workspace / "recipes" / f"{name}.yaml").write_text(of_fork(STARTER.read_text()))
            folder = workspace / "runs" / name
            folder.mkdir(parents=True)
            grown = StageRecord("key", {}, {"vessels": 3}, 1.0, 1.0)
            Manifest(folder, {"recipe": {}}, {"vasculature": grown}).save()
            write_network_csv(folder / "network.csv", FORK)
            views.run_page(folder, "network", workspace / ".printctl" / "pages")
    return names


def test_a_recipe_is_begun_and_mended_in_its_text_and_its_form(
    served: Process, browser: Any
) -> None:
    page = shown(browser, f"{served.url}/design")
    page.get_by_text("A recipe says what is printed and how").wait_for()
    page.get_by_role("button", name="New", exact=True).click()
    dialog = page.get_by_role("dialog", name="New recipe")
    dialog.get_by_label("Begin from").select_option("planar_tree")
    dialog.get_by_label("Name", exact=True).fill("not one")
    dialog.get_by_role("button", name="Make").click()
    dialog.get_by_text("name 'not one' can't be used").wait_for()  # and what was chosen is kept
    assert dialog.get_by_label("Begin from").input_value() == "planar_tree"
    dialog.get_by_label("Begin from").select_option("starter")
    dialog.get_by_label("Name", exact=True).fill("first")
    dialog.get_by_role("button", name="Make").click()
    page.get_by_text("ready to be made").wait_for()
    page.get_by_role("tab", name="Text").click()
    text = page.get_by_label("Recipe as YAML")
    begun = text.input_value()
    text.fill("a: [")
    page.get_by_text("not saved: this can't be read").wait_for()
    text.fill(of_fork(begun))
    page.get_by_text("saved", exact=True).wait_for()
    page.get_by_role("tab", name="Recipe").click()
    layer = page.get_by_label("layer (µm)", exact=True)
    expect(layer).to_have_value("150")
    layer.fill("1")
    page.get_by_text("must be at least 10 (is 1)", exact=True).wait_for()
    page.get_by_role("tab", name="Text").click()
    assert "layer_um: 1, line_um: 400}" in text.input_value()
    page.get_by_role("tab", name="Recipe").click()
    page.get_by_role("list", name="To mend").get_by_role("button").click()
    expect(layer).to_be_focused()
    layer.fill("150")
    page.get_by_text("ready to be made").wait_for()


def test_a_field_is_found_and_a_section_begun_with_what_tells_it_apart(
    served: Process, browser: Any, workspace: Path
) -> None:
    file = workspace / "recipes" / "few.yaml"
    text = "schema: 1 # kept\nname: few\ntissue: {shape: block, size_mm: [6, 6, 4]}\n"
    file.write_text(f"{text}vasculature: {{network: fork.csv, unit: mm}}\n")
    page = shown(browser, f"{served.url}/design?recipe=few")
    page.get_by_label("Find a field").fill("layer")
    page.get_by_role("list", name="Fields found").get_by_text("toolpath › layer (µm)").click()
    field = page.get_by_label("layer (µm)", exact=True)
    expect(field).to_be_focused()
    field.fill("75")
    wait_for(lambda: "layer_um: 75" in file.read_text())
    assert read_text(file.read_text())["toolpath"] == {"method": "fresh", "layer_um": 75}
    assert "schema: 1 # kept" in file.read_text()
    field.fill("")
    # What is left empty goes, but for what tells the section from others.
    wait_for(lambda: read_text(file.read_text()).get("toolpath") == {"method": "fresh"})
    page.get_by_label("Find a field").fill("zzz")
    page.get_by_text("No field has this").wait_for()
    page.get_by_text("oxygen", exact=True).click()
    page.get_by_label("with oxygen").check()
    wait_for(lambda: read_text(file.read_text()).get("oxygen") == {})
    page.get_by_label("with oxygen").uncheck()
    wait_for(lambda: "oxygen" not in file.read_text())
    page.get_by_text("solid", exact=True).click()
    page.get_by_text("more fields, at their defaults").last.wait_for()


def test_who_changes_an_old_version_is_told_and_loads_it_again(
    served: Process, browser: Any, workspace: Path
) -> None:
    file = workspace / "recipes" / "both.yaml"
    file.write_text(of_fork(STARTER.read_text()))
    page = shown(browser, f"{served.url}/design?recipe=both")
    page.get_by_label("seed").wait_for()
    file.write_text(file.read_text().replace("seed: 1", "seed: 7"))
    page.get_by_label("seed").fill("2")
    page.get_by_text("was changed elsewhere meanwhile").wait_for()
    assert "seed: 7" in file.read_text()
    page.get_by_role("button", name="Load it again").click()
    expect(page.get_by_label("seed")).to_have_value("7")
    page.get_by_label("seed").fill("8")
    wait_for(lambda: "seed: 8" in file.read_text())


def test_a_recipe_is_copied_renamed_thrown_away_and_taken_back(
    served: Process, browser: Any, workspace: Path
) -> None:
    (workspace / "recipes" / "old.yaml").write_text(of_fork(STARTER.read_text()))
    page = shown(browser, f"{served.url}/design?recipe=old")
    for button, name in (("Duplicate", "old_2"), ("Rename", "newer")):
        page.get_by_role("button", name=button).click()
        dialog = page.get_by_role("dialog", name=button)
        if button == "Rename":
            dialog.get_by_label("New name").fill(name)
        dialog.get_by_role("button", name=button, exact=True).click()
        page.get_by_role("heading", name=name, exact=True).wait_for()
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Take back newer").click()
    back = workspace / "recipes" / "newer.yaml"
    wait_for(back.is_file)
    page.get_by_role("heading", name="newer", exact=True).wait_for()
    assert read_text(back.read_text())["name"] == "newer"


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
def test_a_design_is_seen_on_one_screen(served: Process, browser: Any, made: Path) -> None:
    page = shown(browser, f"{served.url}/design?recipe=one&tab=figures")
    page.get_by_text("Ink needed").wait_for()
    assert page.get_by_role("link", name="network.csv").is_visible()
    page.get_by_role("tab", name="Look").click()
    network = page.frame_locator('iframe[title="Network in 3D of one"]')
    network.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    names = network.locator("select option").all_inner_texts()
    assert {"Radius / mm", "Lumen error by the G-code / µm"} <= set(names)
    assert page.evaluate("document.documentElement.scrollHeight") <= 800
    page.get_by_role("radio", name="Layers and passes").click()
    layers = page.frame_locator('iframe[title="Layers and passes of one"]')
    layers.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    slider = layers.locator("input[type=range]").first
    before = slider.input_value()
    slider.focus()
    slider.press("ArrowRight")
    assert slider.input_value() != before
    page.get_by_role("radio", name="Report").click()
    page.get_by_text("has no page 'report' yet").wait_for()


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
    page.get_by_text("there is no file 'missing.csv' beside the recipe; upload it").first.wait_for()
    page.get_by_role("button", name="Import").click()
    page.get_by_label("Choose a file").set_input_files(str(vessels))
    page.get_by_text("vessels.csv can be named in recipes now").wait_for()
    page.get_by_label("network", exact=True).select_option("vessels.csv")
    page.get_by_text("ready to be made").wait_for()
    assert "network: vessels.csv" in (workspace / "recipes" / "given.yaml").read_text()


def test_markup_in_a_file_s_name_is_shown_as_text(
    served: Process, browser: Any, tmp_path: Path
) -> None:
    page = shown(browser, f"{served.url}/design")
    page.get_by_role("button", name="Import").click()
    bad = tmp_path / "<img src=x onerror=window.bad=1>.yaml"
    bad.write_text("schema: 1\nname: <img src=x onerror=window.bad=1>\n")
    page.get_by_label("Choose a recipe").set_input_files(str(bad))
    page.get_by_role("list", name="To mend").get_by_text("<img src=x").wait_for()
    expect(page.get_by_label("name", exact=True)).to_have_value("<img src=x onerror=window.bad=1>")
    assert page.evaluate("window.bad") is None


@pytest.mark.slow
def test_inlets_are_picked_on_the_tissue(served: Process, browser: Any, workspace: Path) -> None:
    grown = "tissue: {shape: block, size_mm: [16, 8, 3]}\nvasculature: {grow: tree, terminals: 20}"
    (workspace / "recipes" / "grown.yaml").write_text(f"schema: 1\nname: grown\n{grown}\n")
    page = shown(browser, f"{served.url}/design?recipe=grown")
    page.get_by_text("Pick places on the tissue").click()
    page.get_by_role("button", name="Show the tissue").click()
    tissue = page.frame_locator('iframe[title="Tissue of grown"]')
    tissue.locator("#viewer[data-state=ready]").wait_for(timeout=60_000)
    tissue.get_by_role("button", name="Top", exact=True).click()
    canvas = tissue.locator("#stage canvas")
    for place in ((0.4, 0.5), (0.6, 0.5)):
        size = canvas.bounding_box()
        canvas.click(position={"x": place[0] * size["width"], "y": place[1] * size["height"]})
        page.get_by_text(re.compile("^a further inlet: .* 3 mm$")).wait_for()
        page.wait_for_timeout(500)
    said = read_text((workspace / "recipes" / "grown.yaml").read_text())["vasculature"]["inlets"]
    assert [one["at_mm"][2] for one in said] == [3.0, 3.0]
    assert said[0]["at_mm"][0] < 8.0 < said[1]["at_mm"][0]
    page.get_by_text("ready to be made").wait_for()
