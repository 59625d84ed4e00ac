"""Bluetooth interference: how many frames survive when 1 to 40 piconets at full load share one room.

``survival`` puts concrete frames on the band, and ``links`` does the same with real links that are set up by paging.
``figures`` draws both beside the closed forms. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen
where the source is silent, and ``published.csv`` what it printed.
"""
