"""The terminal itself: what it takes and how quickly, what it replies, and when it is gone."""
