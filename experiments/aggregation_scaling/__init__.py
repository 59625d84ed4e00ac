"""Paper 002's strategies SRP, MRP and MI on areas of 50 m to 200 m, with two and with four sub-teams.

``scaling`` makes a run, whose periods grow with the area, and ``floors`` writes the floors. ``figures`` judges the
claims on large areas and draws search time over the side. ``sweep.yaml`` is where to begin; ``README.md`` says what was
chosen where the source is silent, and ``published.csv`` what it printed.
"""
