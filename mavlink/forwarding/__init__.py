"""Outputs for other programs: received packets in, the same bytes to every output, answers to the UAV."""
