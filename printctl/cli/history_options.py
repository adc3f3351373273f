"""Options of `printctl history` that filter, sort and limit prints, and the query made of them."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.errors import UsageError
from printctl.history.table import day_begins, day_ends
from printctl.machine.link.history_entry import INTERRUPTED
from printctl.machine.link.history_query import HistoryQuery, SortBy
from printctl.machine.link.states import ENDED

STATES = (*sorted(state.value for state in ENDED), INTERRUPTED)

SearchOption = Annotated[
    str,
    typer.Option("--search", help="Words that must all occur: file, hash, profile, alarm ..."),
]
StateOption = Annotated[
    list[str] | None,
    typer.Option(
        "--state",
        help=f"How it ended, any of those given: {', '.join(STATES)}.",
        show_default=False,
    ),
]
ProfileOption = Annotated[str, typer.Option("--profile", help="The printer's profile.")]
WhoOption = Annotated[str, typer.Option("--who", help="The operator.")]
SinceOption = Annotated[str, typer.Option("--since", metavar="DAY", help="First day: 2026-11-01.")]
UntilOption = Annotated[str, typer.Option("--until", metavar="DAY", help="Last day: 2026-11-30.")]
SortOption = Annotated[SortBy, typer.Option("--sort", help="The latest or last name first.")]
ReverseFlag = Annotated[bool, typer.Option("--reverse", help="The other way round.")]
LimitOption = Annotated[
    int | None, typer.Option("--limit", min=1, help="At most so many.", show_default=False)
]


def query_of(
    search: str = "",
    state: list[str] | None = None,
    profile: str = "",
    who: str = "",
    since: str = "",
    until: str = "",
    sort: SortBy = SortBy.STARTED,
    reverse: bool = False,
    limit: int | None = None,
) -> HistoryQuery:
    """Convert the options to a query of the history.

    Raises
    ------
    UsageError
        For a state or a day that there isn't.
    """
    for one in state or ():
        if one not in STATES:
            raise UsageError(f"--state {one!r} isn't one of {', '.join(STATES)}")
    return HistoryQuery(
        words=search,
        states=tuple(state or ()),
        profile=profile,
        who=who,
        since=day_begins(since, "--since"),
        until=day_ends(until, "--until"),
        sort=sort,
        descending=not reverse,
        limit=limit,
    )
