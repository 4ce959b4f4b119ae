"""Flights and replays for others than the operator: programs that are told, browsers that are served."""
