"""Formats of CAD files, one a file; others register under ``tracer.cad_formats``."""
