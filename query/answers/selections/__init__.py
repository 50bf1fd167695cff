"""Rays that satisfy a criterion: searched, kept, written, explained."""
