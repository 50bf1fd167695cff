"""The one wavefront: the next face, the flight, the interaction, the store."""
