"""Live video: when its pictures are dated, and what looking at them takes."""
