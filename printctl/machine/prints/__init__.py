"""A person's view of prints: state, actions, progress, recovery, giving up.

Goes in: a print's folder. Comes out: its state, and what can be done. Begin with `state.py`.
"""
