"""What the experiments with explorers (paper 001) share; no experiment by itself.

``exploring`` makes one exploration and tells, beside its metrics, when how much had been seen, and whether robots part
where they escape. The experiments are ``gain_tuning`` and the folders ``exploration_*``; begin with
``exploration_teams``.
"""
