"""Images of the world: a view in, images and films out."""
