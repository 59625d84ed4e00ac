"""Paper 000, Tables 1 and 2: one robot visits 200 rooms on two floors, alone or with helpers.

``figures`` judges the claims and sets ours beside the tables. ``alternatives`` reads the sweep of
``alternatives.yaml``, which varies what the paper leaves open: ``python -P -m
experiments.reflection_tables.alternatives RESULTS``. ``trajectories`` draws one short run from above. ``sweep.yaml`` is
where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
