"""Sending by the station itself: commands and rate requests in, frames for the UAV's link out."""
