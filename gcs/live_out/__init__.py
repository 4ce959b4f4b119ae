"""Live output of flights and replays for others: the newest snapshot goes to a process for each address, and from
there out as lines, events or pictures. A process that hangs or dies costs the flight nothing and is replaced."""
