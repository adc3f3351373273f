"""A stranger's first parts: generator, truth and judge that share no code with the product."""
