"""Names as subtitles: when each is shown, where it stands, and how each kind of file writes it.

Snapshots come in, one a frame; text files come out, or a copy of the film that has them as a track.
"""
