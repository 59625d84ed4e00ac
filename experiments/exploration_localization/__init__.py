"""Paper 001, section 5.2: speed set by a SLAM filter against true positions, odometry and a constant speed.

``mapping`` makes a run and measures how true maps and poses are while the map grows. ``figures`` judges the paper's
statements and draws errors over time. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
