"""Whom the air of Bluetooth tells of what is on it.

``tenancy`` are radios of other kinds, in an air that they share, ``seats`` the arbiters that divide that between radios
of one robot; ``metering`` counts how long each radio has done what, for the energy that it takes.
"""
