"""Recorded video: packets in and Matroska files out; files in and frames by index and time out."""
