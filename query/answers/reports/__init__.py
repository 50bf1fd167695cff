"""One ray, one place, one scene: reports, audits, sweeps, comparisons."""
