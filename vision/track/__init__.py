"""Tracking: boxes of one frame after another in, tracks with stable numbers out."""
