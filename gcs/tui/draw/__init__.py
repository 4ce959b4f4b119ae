"""Pure drawing: numbers, boxes and images in, cells and strips of text out."""
