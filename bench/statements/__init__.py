"""What is said of a flight, in every place where it is said, held against what is so."""
