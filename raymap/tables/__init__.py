"""Rays as tables for other programs: Arrow, Parquet, CSV; pictures as OpenEXR."""
