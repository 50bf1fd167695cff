"""Pictures without a graphics card, and the same scene for PyVista."""
