"""What the station itself says: orders and rate requests in, frames for the UAV's link out."""
