"""Passes over records: what they find is computed from a recorded map, without tracing."""
