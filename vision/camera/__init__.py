"""Camera geometry: attitude, mount and lens in, rays and pixels out; calibration from a chessboard."""
