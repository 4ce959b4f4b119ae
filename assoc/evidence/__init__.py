"""What tracks and reports say of each other: observations and reports in, log likelihood ratios of pairs out."""
