"""Registration and print comparison reports as PDF, laid out by reportlab (extra ``pdf``).

Goes in: what the HTML report shows. Comes out: PDF bytes. Begin with `report.py`.
"""

from registration.report.pdf.library import pdf_missing, write_comparison_pdf, write_report_pdf

__all__ = ["pdf_missing", "write_comparison_pdf", "write_report_pdf"]
