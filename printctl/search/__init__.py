"""Design search: vary a recipe's keys, grow and measure the candidates, and rank them.

Goes in: a search file. Comes out: ranked candidates, a page, the best as a recipe. Begin with
`run.py`.
"""

from printctl.search.evaluate import evaluate
from printctl.search.model import load_search
from printctl.search.run import SearchResult, run_search

__all__ = ["SearchResult", "evaluate", "load_search", "run_search"]
