"""What the experiments with Bluetooth links share; no experiment by itself.

``clocks`` gives a pager what it would know of the other's clock from an inquiry. It is used by ``page_time``,
``packet_throughput`` and ``piconet_interference``.
"""
