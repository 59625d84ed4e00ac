"""Paper 000, section 7: explorers that help each other, dedicated helpers, and one helper of several explorers.

``roles`` makes a run with so many explorers and helpers. ``figures`` judges the claims and draws steps and time of the
task. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and
``published.csv`` what it printed.
"""
