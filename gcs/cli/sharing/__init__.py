"""Sharing of flights and replays: snapshots published to other programs, screens served to browsers."""
