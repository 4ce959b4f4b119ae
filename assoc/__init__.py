"""Association of image tracks with reported vehicle positions. Plain arrays only; ENU metres, radians, Unix µs."""
