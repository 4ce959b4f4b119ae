"""Missions, who flies with which camera and links: a mission file in, a checked Mission out."""
