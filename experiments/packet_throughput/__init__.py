"""Bluetooth throughput: what a link carries with each packet type at a given Es/N0.

``throughput`` measures it on the channel, with a backlogged master and one slave. ``figures`` draws it beside the
closed form and the reference's table. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
