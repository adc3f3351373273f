"""Records of prints: signed bundles, tables, and exact repeats."""
