"""What the station itself sends: commands and rate requests in, frames for the UAV's link out."""
