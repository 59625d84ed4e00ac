"""Paper 004: group, wave and leap-frog deployment of two to eight robots, with and without augmentations.

``figures`` judges how many robots move in each stage, and what the augmentations are good for. The runs are made by
``experiments.deployment.deploying``. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
