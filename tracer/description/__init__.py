"""Words that all tables of a scene file share: numbers, places, names, channels."""
