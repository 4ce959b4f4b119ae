"""What vehicles and a detector would report: the true world in, MAVLink messages and boxes with errors out."""
