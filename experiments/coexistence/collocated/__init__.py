"""Both radios on one robot: what 802.11 and Bluetooth, or Low Energy, cost each other there, asking and not.

``robots`` measures it, with the link and the station of the folder above, on two robots. ``figures`` judges the claims
and draws them. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen, before the first run.
"""
