"""Screens of a running flight on another terminal: the flight's side, and that of the terminal.

The terminal's side makes a pseudo terminal, hands one end to the flight over a Unix socket, and carries bytes between
the other and the terminal that it runs on. So the flight draws on a terminal that is not its own: no job control of
a shell can stop it, and it ends like any other when who carries the bytes is gone.
"""
