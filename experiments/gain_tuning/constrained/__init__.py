"""Gains by search again, with more offices and searches, as a second reading of paper 001 asks for it.

``sweep.yaml`` is where to begin: twelve offices, twenty searches, and no more ticks in which robots hold each other up
than with the gains by trial. ``figures.py`` answers the rows of published.csv; ``README.md`` says what was chosen,
before the first run.
"""
