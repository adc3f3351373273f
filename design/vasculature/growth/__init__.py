"""Grow one or several vessel trees in a tissue by constrained constructive optimisation.

Goes in: a tissue, a root and options. Comes out: a grown tree. Begin with `tree.py`: the state, the
loop and the result of one tree. `kernel.py` proposes and adds terminals by the sums of `cost.py`,
`index.py` finds what is near, `checks.py` audits and repairs; `regions.py` divides a large tree.
Several trees grow by `forest.py`, in all parts of a tissue by `parts.py`.
"""
