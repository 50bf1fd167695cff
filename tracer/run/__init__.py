"""One run for every way of following light: portions, their order, limits, progress, warnings."""
