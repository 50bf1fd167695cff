"""Formats of lens files, one a file; others register under ``tracer.lens_formats``."""
