"""A child process of tests: does what it is told, one message after the other, until its parent's end closes."""

import os
import signal
import sys
import time

import msgspec

from infra.processes.channel import connect_to_parent


class Begin(msgspec.Struct, tag=True):
    number: int


class Do(msgspec.Struct, tag=True):
    what: str


class Done(msgspec.Struct, tag=True):
    number: int
    what: str


def main():
    parent = connect_to_parent(Begin | Do)
    number = parent.receive().number
    parent.send(Done(number, "begin"))
    try:
        while True:
            what = parent.receive().what
            if what == "die":
                sys.exit("these are its last words")
            if what == "hang":
                signal.pause()
            if what == "burn":
                while True:
                    pass
            if what == "nonsense":
                os.write(int(sys.argv[2]), b"\0\0\0\3abc")
                time.sleep(60)
            parent.send(Done(number, what))
    except EOFError:
        parent.send(Done(number, "end"))


if __name__ == "__main__":
    main()
