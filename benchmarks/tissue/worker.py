"""Grow trees in tissues' files as a user of the Python interface would; a line of JSON for each.

Runs as a process of its own, so that whatever ends it is seen by the one who started it.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from design.errors import DesignError
from design.network_files.csv_format import write_network_csv
from design.tissue import SizeLimits, load_tissue
from design.vasculature import GrowthOptions, grow_parts, parts_to_network

TERMINALS = 60


def main() -> None:
    """Take each file named on the command line in turn."""
    for name in sys.argv[1:]:
        path = Path(name)
        print(json.dumps({"begun": path.stem}), flush=True)
        begin = time.process_time()
        found: dict[str, object] = {"done": path.stem, "refused": "", "told": ""}
        step = "tissue"
        try:
            tissue = load_tissue(path, "mm", limits=SizeLimits(1.0, 1000.0))
            step = "growth"
            grown = grow_parts(tissue, GrowthOptions(terminals=TERMINALS))
            write_network_csv(path.with_suffix(".csv"), parts_to_network(grown))
            found["told"] = " ".join((*tissue.notes, *grown.notes))
        except DesignError as error:
            found["refused"] = f"{step}: {error}"
        except Exception as error:
            found["raised"] = f"{step}: {error!r}"
        found["cpu_s"] = round(time.process_time() - begin, 3)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
