"""MAVLink 2 signatures: keys and packets in, a verdict for each packet and the state of each signed stream out."""
