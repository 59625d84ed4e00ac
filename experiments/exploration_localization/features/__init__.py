"""Speed set by a SLAM filter again, by features and by grids, as a second reading of paper 001 asks for it.

``sweep.yaml`` is where to begin: which filters, scans, thresholds and odometry. ``judging.py`` makes a run, after one
at another seed by which the thresholds are set; ``figures.py`` answers the rows of published.csv. ``README.md`` says
what was chosen, before the first run.
"""
