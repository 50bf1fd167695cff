"""The weighted mode: rare outcomes of light chosen more often, scattered light aimed."""
