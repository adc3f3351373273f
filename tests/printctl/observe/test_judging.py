"""Evidence of a look: readings of the flow, however short it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from firmware_profiles import Ink, load
from printctl.observe.deciding import FlowControl
from printctl.observe.expected import ExpectedInk
from printctl.observe.judging import _flow, _thin, narrowed_lumens, shift_of, telling
from registration.inspection import Lumen, LumenSeen, Shift, Stations, Stretch

HEIGHT, WIDTH = 0.1, 0.25


def seen(lines, ratio, stations=40, noise=0.04, u_ratio=0.01, style="layered"):
    """Stations of lines of 7 mm at 20 mm/s, and the ink that was asked for."""
    rng = np.random.default_rng(3)
    section = load(Ink, "collagen_fresh").bead_section
    m, none = lines * stations, np.zeros((lines, 3))
    wanted = float(section.area(WIDTH, HEIGHT))
    full_width = section.width(wanted * np.broadcast_to(ratio, m), HEIGHT)
    if style == "embedded":
        wanted = np.pi / 4 * WIDTH**2
        full_width = WIDTH * np.sqrt(np.broadcast_to(ratio, m))
    width = full_width * (1 + noise * rng.standard_normal(m))
    full, row = np.ones(m), np.repeat(np.arange(lines), stations)
    along = np.tile(np.arange(stations), lines) * 0.17
    found = Stations(
        np.zeros((m, 2)), full, np.zeros((m, 2)), row, row, along,
        full * 0.17, full * WIDTH, width, full * noise * WIDTH, full * 0, full, full > 0, row * 0,
    )  # fmt: skip
    each = np.ones(lines)
    ink = ExpectedInk(
        (), none, none, each * WIDTH, each * HEIGHT, each * wanted, np.arange(lines),
        np.arange(lines), 0.35 * (np.arange(lines) + 0.5), each, style, each < 0,
    )  # fmt: skip
    return _flow(found, ink, row, u_ratio, section)


@pytest.mark.parametrize("lines", [1, 3, 40])
@pytest.mark.parametrize("ratio", [0.7, 1.3])
def test_a_step_of_the_flow_is_told_by_one_look_of_any_length(lines, ratio):
    control = FlowControl()
    control.learn(seen(12, 1.0))
    control.learn(seen(lines, ratio))
    assert control.flow == pytest.approx(ratio, rel=0.05)


def test_filaments_in_a_bath_correct_the_flow_only_where_several_looks_agree():
    """One picture of a sound print showed a vessel 13 % narrower than it was."""
    control, factors = FlowControl(), []
    control.learn(seen(3, 0.76, style="embedded"))
    assert control.proposal() is None
    for _ in range(6):
        control.learn(seen(3, 0.7, style="embedded"))
        factors.append(control.proposal())
    assert factors[0] is None
    assert factors[-1] == pytest.approx(1 / 0.7, abs=0.12)


def test_narrowed_lumens_are_those_surely_narrower():
    place = np.array([1.0, 1.0, 0.1])
    lumens = [Lumen.capsule(name, place, place, 0.4) for name in "abcd"]
    seen = [
        LumenSeen(name, 0.4, width, 0.01, 1.0, known, 1.0)
        for name, width, known in (
            ("a", 0.4, True), ("b", 0.2, True), ("c", 0.34, True), ("d", np.nan, False)
        )
    ]  # fmt: skip
    assert [one.name for one in narrowed_lumens(lumens, seen, 0.9)] == ["b"]


def test_a_layer_lies_where_the_second_picture_shows_it_if_the_first_shows_none():
    """A vessel of 1 mm, moved by 0.3 mm, went on: the first picture knew no place."""

    def picture(sees, dx):
        shift = Shift(dx, 0.0, 1e-4 * np.eye(2))
        return SimpleNamespace(seen_share=sees, shift=shift)

    none, moved, there = picture(0.0, 0.0), picture(0.8, 0.3), picture(0.8, 0.0)
    for each, told in (((none, moved), 0.3), ((there, moved), 0.0), ((none, None), 0.0)):
        assert shift_of(telling(*each))[0] == told


def test_thin_lines_that_touch_are_filled_up_by_the_share_of_ink_at_their_seams():
    m, section = 60, load(Ink, "collagen_fresh").bead_section
    full, row = np.ones(m), np.zeros(m, dtype=np.int64)
    along = 0.15 * (np.arange(m) + 0.5)
    share = np.where((along > 3.0) & (along < 6.0), 0.4, 1.0)
    stations = Stations(
        np.zeros((m, 2)), full, np.zeros((m, 2)), row, row, along, full * 0.15,
        full * WIDTH, full * np.nan, full * np.nan, full * np.nan, full, full > 0, row, share,
    )  # fmt: skip
    stretch = Stretch("thin", 0, 3.5, 5.5, 0.4, 0.01, 1e-9)
    findings = SimpleNamespace(stations=stations, stretches=(stretch,))
    one = np.ones(1)
    ink = SimpleNamespace(style="layered", height_mm=HEIGHT * one, width_mm=WIDTH * one)
    (found,) = _thin(findings, ink, SimpleNamespace(row=row), section)
    assert (found.from_mm, found.to_mm) == pytest.approx((3.0, 6.0), abs=0.2)
    assert found.missing == pytest.approx(0.6, abs=0.02)
