"""The published experiments on our own flights: their methods as written, our identifier on the very same frames.

Chen, Du, Wu, Drones 2025, 9(9), 612, doi:10.3390/drones9090612, section 4. ``python -m bench.paper``.
"""
