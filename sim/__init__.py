"""The simulated side: printer, dry run, deposit, scanner; no code shared with the writer."""
