"""Place and view of the UAV, beside its film, by the Motion Imagery Standards Board's (MISB) standards.

Snapshots come in; MPEG-TS with KLV goes out. What each tag of ST 0601 holds is told here once, for the reader too.
"""
