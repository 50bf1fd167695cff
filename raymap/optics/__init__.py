"""Formulas of light that reading a map needs: colour, photometry, what cells measure."""
