"""Which features go together: a table that is made by trying each pair on a small scene."""
