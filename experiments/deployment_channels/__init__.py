"""Paper 004: a wave deployment over channels that lose, delay or end, with no robot killed, one, or the host.

``recovering`` makes a run and measures how long the team takes to notice a death and to go on. ``figures`` judges what
does not depend on how messages travel. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
