"""Bluetooth Low Energy throughput: what a link carries, by PHY, length of packets, interval and strength of the signal.

``throughput`` measures it on the channel, with a backlogged central and one peripheral. ``figures`` judges the claims
and draws it. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the sources are silent, and
``published.csv`` what they print.
"""
