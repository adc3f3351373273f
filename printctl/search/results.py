"""Write a search's results: table, plot, page, and the best candidate's recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from design.files import write_bytes, write_text
from printctl.search.best import best_recipe
from printctl.search.figure import pareto_png
from printctl.search.page import search_html
from printctl.search.run import SearchResult
from printctl.search.table import ranked_csv

TABLE: Final = "ranked.csv"
PICTURE: Final = "pareto.png"
PAGE: Final = "search.html"
BEST: Final = "best.yaml"


def write_results(result: SearchResult, out: Path) -> list[Path]:
    """Write all of it; return what was written.

    Raises
    ------
    OSError
        When a file can't be written.
    """
    write_text(out / TABLE, ranked_csv(result))
    write_bytes(out / PICTURE, pareto_png(result))
    write_text(out / PAGE, search_html(result))
    names = [TABLE, PICTURE, PAGE]
    if result.best is None:
        (out / BEST).unlink(missing_ok=True)  # an earlier one, of other limits
    else:
        write_text(out / BEST, best_recipe(result, result.best, out))
        names.append(BEST)
    return [out / name for name in names]
