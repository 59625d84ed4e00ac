"""Paper 001's statements on teams that a second reading of it asks for: declared beside exploration_teams.

``sweep.yaml`` is where to begin: schemas and coordinated frontier assignment, on the same floors and on an office whose
walls have a thickness. ``figures.py`` answers the rows of published.csv; ``README.md`` says what was chosen and why,
before the first run.
"""
