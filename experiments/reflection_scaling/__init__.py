"""Paper 000, section 4.4: goal reflection from 2 to 50 robots, in bytes of a frame, of the team, and targets.

``scaling`` makes a run. ``figures`` judges the paper's bounds, O(M) a robot and O(M^2) in all. ``sweep.yaml`` is where
to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
