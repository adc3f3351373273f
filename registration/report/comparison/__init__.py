"""The comparison of several prints: page, drawings and tables."""

from registration.report.comparison.page import Drawn, comparison_figures, write_comparison_html

__all__ = ["Drawn", "comparison_figures", "write_comparison_html"]
