"""Compares this state of the sources with an earlier build, portion by portion.

``python -m tests.oracle`` installs the earlier build (`OLD`, or ``--old REVISION``) in an
environment of its own, lets both builds run the same jobs, and compares what they wrote:

A : natural, weighted and split light; all samples with their variants, and generated scenes that
    use every kind. Every column of every portion, channels, detector results and answers must be
    equal bit for bit.
B : polarised light, crystals, lens trees. The same, or, where random streams changed, the fluxes of
    all ends must agree by χ² with p > 1e-3.
C : jobs listed in `tests.oracle.jobs.WAS_WRONG`, which the earlier build gets wrong; shown with
    what is right. Their columns must be equal all the same.

Weighted and split light that is drawn otherwise by decision (`tests.oracle.jobs.OTHER_DRAWS`) is
compared as in B. The table of the last whole run is ``tests/oracle/table.md``.

The maps of the earlier build are also opened and asked by this one, and must answer alike.
"""
