"""The identifier over time: frames and reports in, names with probabilities and their evidence out."""
