"""The Monte Carlo engines: emission, nearest surface, interaction, record."""
