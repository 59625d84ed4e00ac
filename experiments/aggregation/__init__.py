"""What the experiments with aggregating search teams (paper 002) share; no experiment by itself.

``searching`` makes one search with several of its settings chosen under one name. ``claims`` has the metrics and the
names of the strategies. The experiments are the folders ``aggregation_*``; begin with ``aggregation_search``.
"""
