"""Paper 000, Figs 16 and 17: what helpers are worth when robots see each other with errors.

``figures`` judges the claims against a robot without helpers and draws the figures. ``alternatives.yaml`` varies what
the paper leaves open. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent,
and ``published.csv`` what it printed.
"""
