"""Atoms of the criteria language, one a file: word, arguments, help, binding, evaluation.

The registry (`query.expression.registry`) finds them by scanning this folder; other distributions
add theirs under the entry-point group ``raymap.atoms``. A file declares its atom in ``KINDS``;
where the Python spelling is more than the class itself it has a function for that, too.
"""
