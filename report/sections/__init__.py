"""Facts and tables of a report.

Goes in: report.json's numbers. Comes out: sections with tables. Begin with `facts.py`.
"""
