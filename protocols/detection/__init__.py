"""Failure detection: how a robot decides from missing heartbeats that another has failed.

Every protocol whose robots send heartbeats can use these parts; nothing here knows any protocol's messages.

- ``detectors``, where to begin: the contract ``Detector``, the settings that a scenario offers, and ``make_detector``.
- ``chen``: the detectors with freshness points of Chen, Toueg and Aguilera, NFD-S and NFD-E.
- ``accrual``: the phi accrual detector, with Akka's and with the exact tail of the normal distribution.
- ``incarnations``: how a reboot of the peer shows in its heartbeats, and the watch over one incarnation.
- ``quality``: Chen's metrics of a detector's speed and of its mistakes.

``protocols.monitoring`` is the smallest protocol that uses them, ``protocols.aggregation.neighbours`` another use.
"""
