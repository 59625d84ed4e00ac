"""Pseudonet: a team covers a floor step by step, and agrees on each step over Bluetooth piconets (paper 003).

Each layer of the paper is a file, from the top down:

- ``application``: the four phases of a step, as a state table; begin here;
- ``coordination``: what a robot wants to do, and how conflicts are settled, with one of ``algorithms``;
  ``reconciliation`` makes the maps of a new team equal before it plans;
- ``messaging``: forms the messages, which ``messages`` (one piconet) or ``wide`` (several) put into bytes;
- ``broadcast``: brings every message to all robots of a piconet; ``relay``, with ``census``, to those of a scatternet;
  both report by ``upcalls``;
- ``bluetooth``: inquiry and paging until the piconet is formed, ``scatternet`` for several, by a ``topology``.

``machine`` joins the layers to what cosim drives, ``setup`` is what all robots know before the run, ``coverage`` is the
referee, and ``spec`` names the protocol to cosim.
"""
