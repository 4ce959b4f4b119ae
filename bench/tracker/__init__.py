"""Trackers side by side on the same simulated traffic: scenes, peers, scores."""
