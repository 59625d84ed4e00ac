"""What the experiments with explorers (paper 001) share; no experiment by itself.

``exploring`` makes one exploration with several of its settings chosen under one name. ``claims`` has the thresholds
and the comparisons that several claims use, ``curves`` draws coverage over time. The experiments are ``gain_tuning``
and the folders ``exploration_*``; begin with ``exploration_teams``.
"""
