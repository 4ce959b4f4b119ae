"""Commands that measure and train detectors: labelled images in, tables, curves and networks out."""
