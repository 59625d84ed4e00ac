"""Paper 003, section VII: mixed footprints, speeds and power classes.

One task covers the floor, the other does not. ``figures`` compares the time of a mixed team with that of a team of
equals in the same worlds. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is
silent, and ``published.csv`` what it printed.
"""
