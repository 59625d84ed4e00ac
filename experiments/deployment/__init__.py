"""What the experiments with coordinated deployment (paper 004) share; no experiment by itself.

``deploying`` makes one deployment from random starts about base. The experiments are the folders ``deployment_*``;
begin with ``deployment_strategies``.
"""
