"""Bluetooth paging: how long a page takes until the paged device answers, by scan mode and clock estimate.

``paging`` makes pages, each on a channel of its own. ``figures`` judges the claims and draws the distributions.
``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv``
what it printed.
"""
