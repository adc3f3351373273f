"""What simulates, or reads, one firmware family each: a folder for a family."""
