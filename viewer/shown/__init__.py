"""The scene as named parts with revisions, and what draws them: pages, windows, notebooks."""
