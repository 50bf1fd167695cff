"""Scenes: descriptions read and validated, compiled into tables for the engines."""
