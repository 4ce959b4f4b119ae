"""Flights with troubles, recorded and identified again: whether both say the same of every box."""
