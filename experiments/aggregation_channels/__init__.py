"""Paper 002's searches with messages that arrive at once, over 802.11, and over 802.11 that is jammed.

``figures`` judges the paper's claims for each network and draws what each costs. ``sweep.yaml`` is where
to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
