"""History filter: form values and URL round trip; invalid ones dropped."""

from __future__ import annotations

from urllib.parse import parse_qsl, urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.web.history.print_filter import PrintFilter

FILTERS = st.builds(
    PrintFilter,
    words=st.text(max_size=20),
    state=st.sampled_from(["", "done", "killed"]),
    who=st.text(max_size=20),
    since=st.sampled_from(["", "2026-01-31"]),
    sort=st.sampled_from(["started", "file"]),
    descending=st.booleans(),
)


@given(FILTERS, st.integers(0, 10_000))
def test_an_address_says_the_same_as_its_form(print_filter: PrintFilter, page: int) -> None:
    asked = dict(parse_qsl(urlsplit(print_filter.address(page)).query, keep_blank_values=True))
    assert PrintFilter.asked(asked) == (print_filter, page)


@pytest.mark.parametrize(
    "asked",
    [
        {"sort": "nonsense"},
        {"since": "yesterday", "until": "0000-00-00"},
        {"page": "-1"},
        {"page": "²"},
        {"page": "9" * 99},
        {"page": "0"},
        {"descending": "maybe", "other": "1"},
    ],
)
def test_nonsense_is_left_out(asked: dict[str, str]) -> None:
    assert PrintFilter.asked(asked) == (PrintFilter(), 0)
