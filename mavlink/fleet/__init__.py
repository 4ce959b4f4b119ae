"""The fleet's state: verified packets in, everybody at any time and notices for the operator out."""
