"""What the experiments with aggregation (paper 002) share; no experiment by itself.

``strategies`` compares the paper's strategies with each other under one condition, a fault or a network: which is the
fastest, what each costs by the task and by the minute, and a bar a strategy. The experiments are the folders
``aggregation_*``; begin with ``aggregation_search``.
"""
