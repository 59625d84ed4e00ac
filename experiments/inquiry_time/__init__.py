"""Bluetooth inquiry: how long a device takes to be found, with three versions of inquiry scan.

``discovery`` makes inquiries, each with devices of its own. ``figures`` judges the claims and draws the distributions.
``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv``
what it printed.
"""
