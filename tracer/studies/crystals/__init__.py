"""Crystals that split light: cases with known answers, and pictures."""
