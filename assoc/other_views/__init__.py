"""What the views of other cameras tell of a view's tracks: which boxes are one vehicle, and whose answer counts."""
