"""Paper 001, section 5.1: gains by differential evolution against those of an informed trial.

``tuning`` makes a search, and tries its result in offices that no search has seen. ``figures`` judges whether the gains
found are better and draws the searches. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
