"""Who is who: association of image tracks with reported positions. Plain arrays only; ENU metres, radians, Unix µs."""
