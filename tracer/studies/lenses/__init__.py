"""Lenses as trees of rays: cones of polarisation, coatings, rings."""
