"""Joint hypotheses of pose and assignment: evidence of pairs in, the likeliest assignments and marginals out."""
