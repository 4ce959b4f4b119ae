"""Several senders of one system id: packets and positions in, a verdict whether they can be one vehicle out."""
