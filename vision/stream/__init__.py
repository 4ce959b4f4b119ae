"""Live video: a source's address in, time-stamped frames, an untouched recording and the stream's health out."""
