"""Routers of an ad hoc network: machines that take packets and time in, and leave packets, payloads and fates.

Begin with ``base``: what every router is, and the queues that it leaves its output in. ``flooding`` is the simplest
router and shows the whole contract in one file; ``ip`` packs what all of them send.

``aodv`` is RFC 3561, on demand: ``aodv_control`` handles its messages, ``aodv_routes`` the table, ``aodv_search`` the
searches, ``aodv_output`` what is sent, and ``aodv_wire`` the bytes. ``olsr`` is RFC 3626, proactive:
``olsr_neighbours`` learns from HELLOs, ``olsr_graph`` computes relays and routes, ``olsr_wire`` has the bytes.
"""
