"""Results of a flight: snapshots and truth in, roll call, score and marked images out."""
