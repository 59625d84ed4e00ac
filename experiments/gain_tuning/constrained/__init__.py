"""Gains by search again, with more offices and searches, as a second reading of paper 001 asks for it.

``sweep.yaml`` is where to begin; ``README.md`` says what was chosen, before the first run.
"""
