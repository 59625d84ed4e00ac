"""What a station of 802.11 costs a link of Bluetooth or Low Energy, by the distance between them.

It is measured by ``sharing`` of the folder above. ``figures`` judges the claims and draws them. ``sweep.yaml`` is where
to begin; ``README.md`` says what was chosen, before the first run.
"""
