"""Hearts keep their main branches while pressure drops and radii are chosen."""

from dataclasses import replace

import numpy as np
import pytest

from design.anatomy.heart import HeartAnatomy, grow_heart
from design.anatomy.presets import PRESETS
from design.anatomy.trunk_lines import lines_of
from design.measures.published_radii import PublishedMatch
from design.tissue import biventricle, tissue_from_surface
from design.units import PA_PER_MMHG
from tests.design.anatomy.hearts import HEART, heart_tissue, trunk_length


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sd_then", "factor"), [((0.9,), 1.1), ((3.0, 0.9), 1.1**0.5), ((3.0, 2.5, 2.5), 1.0)]
)
def test_a_heart_gets_another_pressure_drop_where_that_is_nearer_to_published_radii(
    monkeypatch, sd_then, factor
):
    matches = iter([PublishedMatch(2.0, 1.1), *(PublishedMatch(sd, 1.0) for sd in sd_then)])
    monkeypatch.setattr("design.anatomy.published_drop.published_match", lambda *_: next(matches))
    few = replace(HEART, terminals=40)
    made = grow_heart(heart_tissue(), few, HeartAnatomy(trunk_ends=10, published_radii=True))
    wanted = HEART.pressure_drop_pa / factor**4
    assert [tree.pressure_drop_pa for tree in made.trees] == pytest.approx([wanted] * 2)
    assert any("pressure_drop_mmhg was taken as" in note for note in made.notes) == (factor != 1.0)


@pytest.mark.slow
def test_another_drop_that_costs_main_branches_is_not_taken(monkeypatch):
    """A heart of 80 mm lost 29 % of its trunks to radii nearer to the published ones."""
    matches = iter([PublishedMatch(2.0, 1.1), *[PublishedMatch(0.9, 1.0)] * 3])
    lengths = iter([100.0, 80.0, 80.0, 80.0])
    monkeypatch.setattr("design.anatomy.published_drop.published_match", lambda *_: next(matches))
    monkeypatch.setattr("design.anatomy.published_drop.trunks_mm", lambda _: next(lengths))
    few = replace(HEART, terminals=40)
    made = grow_heart(heart_tissue(), few, HeartAnatomy(trunk_ends=10, published_radii=True))
    assert [tree.pressure_drop_pa for tree in made.trees] == pytest.approx(
        [HEART.pressure_drop_pa] * 2
    )


def test_a_small_heart_keeps_its_main_branches():
    """The circumflex was taken away for the anterior descending beside it at their fork."""
    shape = biventricle(60.0)
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    drop = PRESETS["heart"].pressure_drop_mmhg * PA_PER_MMHG
    options = replace(HEART, terminals=160, clearance_mm=0.05, pressure_drop_pa=drop)
    made = grow_heart(tissue, options, HeartAnatomy(trunk_ends=40))
    assert trunk_length(made.trees) > 600.0
    assert not any("were left out" in note for note in made.notes)


@pytest.mark.slow
def test_forks_too_narrow_for_their_radii_lose_no_branch(monkeypatch):
    """The fork moved on: 154 of 341 mm were left when the thinner branch was left away."""
    planned = []

    def lines_kept(*given):
        planned.append(lines_of(*given))
        return planned[-1]

    monkeypatch.setattr("design.anatomy.heart.lines_of", lines_kept)
    shape = biventricle(30.0)
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    crowded = replace(HEART, terminals=160, pressure_drop_pa=970.0, seed=3)
    made = grow_heart(tissue, crowded, HeartAnatomy(trunk_ends=40))
    lines = planned[0]
    below = np.flatnonzero(lines.parent >= 0)
    pieces = lines.points[below] - lines.points[lines.parent[below]]
    assert trunk_length(made.trees) > 0.94 * np.linalg.norm(pieces, axis=1).sum()
    assert not any("were left out" in note for note in made.notes)
