"""Oriented detection: an image in, boxes with score and heading out."""
