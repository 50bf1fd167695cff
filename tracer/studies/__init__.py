"""Studies: commands that compute or draw something beside recorded maps."""
