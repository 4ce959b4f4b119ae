"""A fleet that misbehaves on request: a list of troubles in, datagrams in order of time out."""
