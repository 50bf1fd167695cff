"""Formats of pictures: a format a file."""
