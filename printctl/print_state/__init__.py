"""State of a print and its allowed actions, shared by page, API, command line and history.

Goes in: a print's folder. Comes out: its state, and the actions that are allowed. Begin with
`state.py`.
"""
