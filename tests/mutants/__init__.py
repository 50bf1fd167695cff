"""Falsifies what stands once, and shows that every feature that leans on it turns red.

``python -m tests.mutants [NAME …]`` copies the sources, writes a wrong number into the one place of
a formula, and runs a test of each feature against the copy. A feature whose test still passes does
not use the formula, or is not tested: it is named, and the command exits with 1.
"""
