"""Coexistence at 2.4 GHz: what 802.11, Bluetooth and Bluetooth Low Energy cost each other in one air.

``sharing`` measures it: links of one kind and two stations of 802.11, of which one broadcasts. ``figures`` judges the
claims and draws them. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the sources are
silent, and ``published.csv`` what they print.
"""
