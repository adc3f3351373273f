"""Trees joined to closed loops: terminals matched, ways found, curves laid."""
