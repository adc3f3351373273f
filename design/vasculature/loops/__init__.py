"""Join trees to closed loops: match terminals, find routes, fit curves."""
