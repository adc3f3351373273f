"""Signed distance to a needle's shaft, and its gradient."""

from __future__ import annotations

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.toolpath.embedded.needle import Needle, off_shaft, off_shaft_slopes
from tests.slower import examples

STEP = 1e-6


@settings(max_examples=examples(300), deadline=None)
@given(
    across=st.floats(0, 3),
    height=st.floats(-2, 4),
    to=st.tuples(st.floats(0, 3), st.floats(-2, 4)),
    needle=st.sampled_from([(0.36, 0.36, 0.0), (0.16, 0.4, 1.5), (0.12, 0.6, 3.0)]),
)
def test_slopes_bound_the_distance_everywhere_and_are_those_of_small_steps(
    across, height, to, needle
):
    tip, shaft, cone = needle
    one = Needle(tip, tip, tip, shaft, cone, 0.5)
    off, outward, up = off_shaft_slopes(across, height, one)
    assert off == off_shaft(across, height, one)
    tangent = off + outward * (to[0] - across) + up * (to[1] - height)
    assert off_shaft(*to, one) >= tangent - 1e-9
    assume(across > STEP)
    for slope, (dx, dz) in ((outward, (STEP, 0)), (up, (0, STEP))):
        ahead = (off_shaft(across + dx, height + dz, one) - off) / STEP
        behind = (off - off_shaft(across - dx, height - dz, one)) / STEP
        low, high = sorted((behind, ahead))
        assert low - 1e-4 <= slope <= high + 1e-4
