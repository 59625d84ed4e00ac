"""Discovery by Bluetooth Low Energy: how long until a scanner hears an advertiser, by interval, scan and window.

``discovery`` measures it, on the whole channel and on its events and windows alone. ``exact`` has the solutions that it
is set beside. ``figures`` judges the claims and draws them. ``sweep.yaml`` is where to begin; ``README.md`` says what
was chosen where the sources are silent, and ``published.csv`` what they print.
"""
