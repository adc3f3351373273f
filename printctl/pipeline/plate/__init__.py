"""Run over a well plate: each well's own run, the combined job, the scanned wells."""
