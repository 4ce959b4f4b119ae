"""What a flight amounted to: snapshots and truth in, roll call, score and marked images out."""
