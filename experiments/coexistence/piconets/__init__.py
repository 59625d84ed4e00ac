"""802.11 under one to forty piconets, with and without adaptive frequency hopping.

``crowd`` measures it, with the links and the station of the folder above. ``figures`` judges the claims and draws them.
``sweep.yaml`` is where to begin; ``README.md`` says what was chosen, before the first run.
"""
