"""Formats of mesh files, one a file; others register under ``tracer.mesh_formats``."""
