"""Paper 003, Fig. 9b: how many slots until all robots know the states of all, by broadcast and by unicast.

``delay`` counts the slots of each strategy. ``figures`` judges the claims that no single number decides. ``sweep.yaml``
is where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
