"""From video to tracks: frames, camera geometry, oriented detection, tracking. Pixels, radians, ENU metres, Unix µs."""
