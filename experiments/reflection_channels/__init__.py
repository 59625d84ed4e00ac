"""Paper 000's goal reflection when messages take time: on an optical link, over Bluetooth and over 802.11.

``figures`` judges what each link costs in steps, delay and stale advice, against messages that arrive at once. The runs
are made by ``experiments.reflection.reflecting``. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen
where the source is silent, and ``published.csv`` what it printed.
"""
