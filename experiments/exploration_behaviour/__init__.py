"""Paper 001's behaviour without its escape, without avoid-robot, with its printed A*, with wide obstacles.

``figures`` judges each part of the behaviour against its absence. The runs are made by
``experiments.exploration.exploring``. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
