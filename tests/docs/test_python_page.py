"""Python examples of docs/python.md: run as documented."""

import doctest
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def test_examples_of_the_page_run_as_printed(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = doctest.testfile(
        str(PAGE), module_relative=False, optionflags=doctest.ELLIPSIS | doctest.REPORT_NDIFF
    )
    assert found.attempted > 25
    assert found.failed == 0
