"""Recordings for the tools that roboticists use: MCAP with Foxglove's schemas, ROS 2 bags."""
