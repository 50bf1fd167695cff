"""Formats of charts, a file each."""
