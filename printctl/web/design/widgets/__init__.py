"""Widgets of the Design page: recipe editor, run control, run views, comparison.

Goes in: the page's service. Comes out: the tabs of the page. Begin with `editor.py`.
"""
