"""The viewer: a run in a browser of this computer, recorded or under way, of any protocol.

``server`` is where to begin: it serves one session to its pages, by HTTP and a WebSocket, behind ``guard``, which
refuses other web sites. A session is a run that pages look at: ``recorded`` plays the tables that a run has written,
``live`` simulates one at the ``pacing`` that its pages ask for. ``messages`` is the language between server and pages,
``history`` and ``rows`` what is sent of the past, ``scenes`` what does not change during a run.

``static`` holds the page that shows a run, and the modules that all pages share. A page with an operator comes with the
protocol whose consoles it knows (:mod:`cosim.page`); what is said at a console passes through here unread.
"""
