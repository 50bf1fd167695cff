"""Backward pictures of crystals: what a camera sees through them."""
