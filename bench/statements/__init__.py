"""Statements about a flight, in every place where they are made, held against the truth."""
