"""Trees grown by constrained constructive optimisation, one or several in a tissue."""
