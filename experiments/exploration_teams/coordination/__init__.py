"""Paper 001's statements on teams that a second reading of it asks for: declared beside exploration_teams.

``sweep.yaml`` is where to begin; ``README.md`` says what was chosen and why, before the first run.
"""
