"""Compiled functions: their decorators, where their code is kept, what is compiled when."""
