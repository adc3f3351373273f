"""Sections of which only part of the wall is a vessel's own: diameters and their intervals."""

import numpy as np
import pytest

from registration.gauging.sections import RAYS, Sections, partial_noise

RADIUS, BLUR = 0.15, 0.02


def sections(met: float, scatter: float, seed: int, count: int = 400) -> Sections:
    """Lumens of `RADIUS`, of whose rays the others look into a neighbour and aren't met."""
    random = np.random.default_rng(seed)
    rays = RADIUS + scatter * random.standard_normal((count, RAYS))
    rays[:, round(met * RAYS) :] = np.nan
    share = np.isfinite(rays).mean(axis=1)
    nothing = np.full(count, np.nan)
    # Unmet rays are filled in longer than any that met the wall.
    median = 2 * np.median(np.where(np.isfinite(rays), rays, 1.0), axis=1)
    yes, no = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    return Sections(
        yes, no, nothing, median, share, nothing, np.zeros((count, 2)), rays, nothing, nothing
    )


@pytest.mark.parametrize("met", [0.6, 0.75, 0.9])
@pytest.mark.parametrize("scatter", [0.005, 0.02])
def test_the_interval_holds_the_diameter(met, scatter):
    found = sections(met, scatter, seed=3)
    noise = partial_noise(found, BLUR)
    inside = np.abs(found.median - 2 * RADIUS) < 1.96 * noise
    assert inside.mean() > 0.95
    # It isn't so wide that it says nothing.
    assert np.median(noise) < 4 * scatter


def test_under_half_of_the_wall_tells_nothing():
    assert np.isnan(partial_noise(sections(0.4, 0.01, seed=1), BLUR)).all()


def test_less_of_the_wall_is_less_sure():
    noise = [np.median(partial_noise(sections(met, 0.01, seed=2), BLUR)) for met in (0.6, 0.8, 1.0)]
    assert noise[0] > noise[1] > noise[2] > 0.0
