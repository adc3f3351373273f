"""Records of prints that a lab can file: signed bundles, tables, and prints done again."""
