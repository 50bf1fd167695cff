"""Processes of their own for what may hang or grow."""
