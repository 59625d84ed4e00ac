"""Paper 001: teams of 1 to 8 robots explore three floors by motor schemas, and by choosing frontiers.

``figures`` judges the statements on teams and draws time over team size; the runs are made by
``experiments.exploration.exploring``. ``floors`` writes the floors of all explorations. ``growing`` draws one run from
above: ``python -P -m experiments.exploration_teams.growing PICTURE.png``. ``sweep.yaml`` is where to begin;
``README.md`` says what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
