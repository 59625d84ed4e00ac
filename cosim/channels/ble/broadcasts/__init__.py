"""Payloads for everyone: the ways in which they are sent, each of which is advertising.

``ways`` says which there are. What they share is in ``events``: waiting for the antenna, putting packets on the air,
judging who hears them. ``extended`` and ``legacy`` send a payload as an advertising set of its own, of which a device
has several at once (``sets``); ``mesh`` floods it, ``inbox`` puts together what comes.
"""
