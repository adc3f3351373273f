"""Flow, oxygen, dye and films of a design or a print."""
