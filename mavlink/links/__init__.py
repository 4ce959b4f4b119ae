"""Transports: UDP, TCP and serial ports in and out; batches of time-stamped frames with their sender come in."""
