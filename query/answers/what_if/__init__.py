"""What a recorded map would show if something were changed."""
