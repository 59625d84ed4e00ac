"""Floors that several experiments share, as ``.yaml`` files that a scenario names by their paths.

The head of each file says where the floor comes from and draws it. ``experiments.exploration_teams.floors`` and
``experiments.aggregation_scaling.floors`` write some of them.
"""
