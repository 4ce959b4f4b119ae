"""Motion of the camera between two frames, by their pixels: images in, a homography and the rotation in it out."""
