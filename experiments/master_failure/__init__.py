"""A piconet loses its master, in the set-up or later: how long until the others go on without it.

``failure`` makes a run of a team in which a robot dies, and reads from its events when the others notice and go on.
``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv``
what it printed.
"""
