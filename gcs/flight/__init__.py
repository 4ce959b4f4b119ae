"""A live flight: links and a camera in, a recording and snapshots out."""
