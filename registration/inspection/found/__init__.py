"""What is read from ink along lines: gaps, widths, stretches, blobs and lumens."""
