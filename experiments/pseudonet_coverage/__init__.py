"""Paper 003: teams of 2 to 8 robots cover a floor while their messages wait for Bluetooth slots.

``figures`` judges what Bluetooth costs against the ideal channel. It is the plainest experiment: a scenario, axes, and
claims. ``sensitivity_*.yaml`` vary what the paper leaves open. ``sweep.yaml`` is where to begin; ``README.md`` says
what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
