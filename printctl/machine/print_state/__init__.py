"""Determine a print's state and allowed actions; continue or give up an interrupted print.

Goes in: a print's folder. Comes out: its state, and the actions that are allowed. Begin with
`state.py`.
"""
