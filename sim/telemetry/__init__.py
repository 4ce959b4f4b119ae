"""Reports of vehicles and a detector: the true world in, MAVLink messages and boxes with errors out."""
