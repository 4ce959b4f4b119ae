"""The fleet's state: verified packets in, the state at any time and notices for the operator out."""
