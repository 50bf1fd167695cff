"""The words of a ray map: events, records, portions, directory, units, limits, errors."""
