"""HTML report comparing several prints of one design: page, figures and tables.

Goes in: a comparison. Comes out: HTML. Begin with `page.py`.
"""

from registration.report.comparison.page import Drawn, comparison_figures, write_comparison_html

__all__ = ["Drawn", "comparison_figures", "write_comparison_html"]
