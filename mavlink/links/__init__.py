"""Transports: UDP, TCP and serial ports in, batches of time-stamped packets with their sender out."""
