"""Paper 002, Figure 4: a host and two searchers look for three targets in a laboratory.

``placing`` makes a run: the robots start up to a few centimetres beside their places. ``figures`` judges the claims by
target distribution, from easy to hard, and draws Figure 4. ``sweep.yaml`` is where to begin; ``README.md`` says what
was chosen where the source is silent, and ``published.csv`` what it printed.
"""
