"""Evidence that tracks and reports fit each other: observations and reports in, log likelihood ratios of pairs out."""
