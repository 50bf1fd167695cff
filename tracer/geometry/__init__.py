"""Shapes and bodies: what light can meet, and where it meets it first."""
