"""Widgets of the Scan page: slices, registration, result.

Goes in: the page's service. Comes out: the cards of the page. Begin with `slices_card.py`.
"""
