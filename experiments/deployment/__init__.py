"""What the experiments with coordinated deployment (paper 004) share; no experiment by itself.

``deploying`` makes one deployment from random starts with several of its settings chosen under one name. ``claims`` has
the answers that several experiments ask for. The experiments are the folders ``deployment_*``; begin with
``deployment_strategies``.
"""
