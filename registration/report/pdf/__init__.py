"""Registration report as PDF, laid out by reportlab (extra ``pdf``) without a browser."""

from registration.report.pdf.library import pdf_missing, write_comparison_pdf, write_report_pdf

__all__ = ["pdf_missing", "write_comparison_pdf", "write_report_pdf"]
