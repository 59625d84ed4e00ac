"""Failure detectors: how fast each notices that heartbeats have ended, against how often it is wrong.

``detection`` judges the heartbeats of one robot by all detectors at once. ``theory`` has the theorem of Chen, Toueg and
Aguilera to compare with. ``figures`` judges the claims and draws mistakes over detection time. ``sweep.yaml`` is where
to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
