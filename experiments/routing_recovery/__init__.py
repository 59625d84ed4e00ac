"""802.11 routing: a relay dies while payloads go over it; how long until they take another way.

``recovery`` makes a run and measures outage, losses and control traffic. ``omniscient`` is a router that knows
everything, a bound for all. ``figures`` judges the claims. ``sweep.yaml`` is where to begin; ``README.md`` says what
was chosen where the source is silent, and ``published.csv`` what it printed.
"""
