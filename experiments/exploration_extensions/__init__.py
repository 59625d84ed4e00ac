"""Paper 001's future work: information utility, beacons in sight and leapfrogging against its schemas.

``watching`` makes a run and measures how much robots see of each other. ``figures`` judges each extension against the
plain schemas. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and
``published.csv`` what it printed.
"""
