"""All flights of a batch on one page: its table of flights in, one HTML file out."""
