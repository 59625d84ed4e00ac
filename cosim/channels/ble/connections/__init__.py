"""Connections, without a clock and without an air: begin with ``link``, which has two ends and goes event by event.

``parameters`` and ``anchors`` say when its events are, ``connection`` when it changes or is given up; ``exchange`` goes
through one event, in which each end has its ``arq``.
"""
