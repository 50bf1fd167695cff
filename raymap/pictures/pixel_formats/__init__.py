"""Formats of plain pixels, a file each."""
