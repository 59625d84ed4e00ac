"""Speed set by a SLAM filter again, by features and by grids, as a second reading of paper 001 asks for it.

``sweep.yaml`` is where to begin, ``judging.py`` makes a run; ``README.md`` says what was chosen, before the first run.
"""
