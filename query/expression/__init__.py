"""Criteria as trees: nodes, text, JSON, Python."""
