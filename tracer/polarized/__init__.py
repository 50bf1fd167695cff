"""Polarised light along the rays of the wavefront."""
