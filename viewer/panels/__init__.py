"""The panels of the application."""
