"""Paper 002, Figure 2: three hosts and six searchers look for three targets in 20 rooms.

All is well, one host is out of range, or one is dead. ``figures`` judges the claims and draws Figure 2.
``alternatives.yaml`` varies what the paper leaves open. ``sweep.yaml`` is where to begin; ``README.md`` says what was
chosen where the source is silent, and ``published.csv`` what it printed.
"""
