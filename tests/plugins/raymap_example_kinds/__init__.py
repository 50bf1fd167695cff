"""Kinds of every sort, one a file, registered by the entry points of this distribution."""
