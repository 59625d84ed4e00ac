"""Paper 004, sections 2 and 6: some robots explore, all return to base, then four deploy by the map just made.

``learning`` makes a run of three plays and measures each. ``figures`` judges whether robots return and deploy.
``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv``
what it printed.
"""
