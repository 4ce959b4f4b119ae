"""Views of other cameras and a view's tracks: which boxes are one vehicle, and whose answer counts."""
